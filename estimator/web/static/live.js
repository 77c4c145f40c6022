// One websocket a page. watch(topic, take) asks for a topic; take gets what a JSON frame says, or a DataView of a binary one.
// A topic that is vital must come every second: when it stops, the banner says so, and the page turns pale.

const LATER = 1013, LATE_MS = 4000, GONE_MS = 10000, RETRY_MS = [300, 1000, 2000, 4000];
// of a topic that is told in words: the page's own language
export const spoken = (topic) => `${topic}@${document.documentElement.lang}`;

const takers = new Map(), vital = new Set();
const banner = document.getElementById("lost");
let socket = null, tries = 0, heard = performance.now(), lost = performance.now(), wanted = true, full = false;
let moved = 0; // when the socket was opened, or something came by it

export function watch(topic, take, { must = false } = {}) {
  takers.set(topic, take);
  if (must) vital.add(topic);
  ask();
}

export function unwatch(topic) {
  takers.delete(topic);
  ask();
}

function ask() {
  if (socket?.readyState === WebSocket.OPEN)
    socket.send(JSON.stringify({ watch: wanted ? [...takers.keys()] : [] }));
}

function connect() {
  const opened = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
  opened.binaryType = "arraybuffer";
  opened.onopen = () => { moved = performance.now(); ask(); };
  opened.onmessage = (event) => {
    tries = 0; // one that is full lets in, and closes
    full = false;
    take(event.data);
  };
  opened.onclose = (event) => {
    if (socket !== opened) return;
    full = event.code === LATER;
    socket = null;
    setTimeout(connect, RETRY_MS[Math.min(tries++, RETRY_MS.length - 1)]);
  };
  socket = opened;
}

// The end of a connection that has died on the way is told nobody.
function beginAnew() {
  socket.onmessage = socket.onclose = null;
  socket.close();
  connect();
}

function take(data) {
  moved = performance.now();
  if (typeof data === "string") {
    const frame = JSON.parse(data);
    if (vital.has(frame.topic)) heard = performance.now();
    takers.get(frame.topic)?.(frame.is);
    return;
  }
  const bytes = new Uint8Array(data), length = bytes[0];
  const topic = new TextDecoder().decode(bytes.subarray(1, 1 + length)), begin = (length + 8) & ~7;
  takers.get(topic)?.(data.slice(begin));
}

function look() {
  const now = performance.now(), silent = wanted && now - heard > LATE_MS;
  if (!silent) lost = heard;
  document.body.classList.toggle("old", silent);
  banner.hidden = !silent;
  if (silent && now - moved > GONE_MS && socket?.readyState === WebSocket.OPEN) beginAnew();
  if (silent) say(banner, full ? banner.dataset.full : banner.dataset.words.replace("{seconds}", Math.round((now - lost) / 1000)));
}

export function say(element, words) {
  if (element.textContent !== words) element.textContent = words;
}

const troubles = document.getElementById("troubles");
export function trouble(all) {
  if (troubles.textContent === all.join("")) return;
  troubles.replaceChildren(...all.map((words) => Object.assign(document.createElement("p"), { className: "banner bad", textContent: words })));
}

document.addEventListener("visibilitychange", () => {
  wanted = !document.hidden;
  heard = performance.now();
  ask();
});
setInterval(look, 500);
connect();

// The ward page: tiles kept true, those that need a person first, or as the reader has chosen.

import { alerts } from "./alerts.js";
import { chosen, keep, showNumbers } from "./choice.js";
import { fill, shape, tone } from "./fields.js";
import { say, spoken, trouble, unwatch, watch } from "./live.js";
import { Strip, spark } from "./pictures.js";

const list = document.getElementById("tiles"), template = document.getElementById("tile");
const find = document.getElementById("find"), order = document.getElementById("order"), pause = document.getElementById("pause");
const tiles = new Map(); // id -> { element, strip, spark, seen, number }
const only = chosen.only;
find.value = chosen.find;
if ([...order.options].some((one) => one.value === chosen.order)) order.value = chosen.order;
for (const chip of document.querySelectorAll("[data-only]")) chip.setAttribute("aria-pressed", String(only.has(chip.dataset.only)));
let page = null;

const seen = new IntersectionObserver((entries) => {
  for (const entry of entries) {
    const tile = tiles.get(entry.target.dataset.id);
    if (!tile) continue;
    tile.seen = entry.isIntersecting;
    if (tile.seen) tile.strip.size();
  }
}, { rootMargin: "50px" });

function adopt(element, id) {
  element.dataset.id = id;
  const tile = { element, strip: new Strip(element.querySelector(".strip")), spark: element.querySelector(".spark"), seen: false };
  tiles.set(id, tile);
  seen.observe(element);
  return tile;
}

for (const element of list.children) adopt(element, element.dataset.id);

watch(spoken("ward"), (now) => {
  page = now;
  tell(now);
  for (const fields of now.tiles) {
    const tile = tiles.get(fields.id) ?? adopt(template.content.firstElementChild.cloneNode(true), fields.id);
    const element = tile.element;
    tile.number = fields.number;
    if (!element.isConnected) list.append(element);
    const place = `/devices/${encodeURIComponent(fields.id)}`;
    element.querySelector("h2 a").setAttribute("href", place);
    element.querySelector(".calibrate a").setAttribute("href", `${place}/calibrate`);
    fill(element, fields);
    tone(element, fields.tone);
    element.toggleAttribute("data-needs", fields.needs);
  }
  const there = new Set(now.tiles.map((fields) => fields.id));
  for (const [id, tile] of tiles) if (!there.has(id)) { seen.unobserve(tile.element); tile.element.remove(); tiles.delete(id); }
  head(now);
  arrange();
}, { must: true });

const MOST_WAITING = 60; // frames while nothing is drawn, as of a page behind others
let waiting = [];
function rates(data) {
  if (waiting.push(new Float32Array(data, 8)) > MOST_WAITING) waiting.shift();
}

function draw() {
  const frames = waiting;
  waiting = [];
  if (frames.length && pause.getAttribute("aria-pressed") !== "true") {
    for (const rates of frames)
      for (const tile of tiles.values()) {
        const at = 2 * tile.number;
        if (tile.seen && at + 1 < rates.length) tile.strip.draw(rates[at], rates[at + 1]);
      }
  }
  requestAnimationFrame(draw);
}
requestAnimationFrame(draw);

const points = 40;
function biases(data) {
  const seconds = new Float64Array(data, 0, 1)[0], rows = new Float32Array(data, 8), short = seconds < 100;
  const words = list.dataset[short ? "seconds" : "minutes"].replace("{n}", Math.round(short ? seconds : seconds / 60));
  for (const tile of tiles.values()) {
    const at = tile.number * points * 6;
    say(tile.element.querySelector(".span"), words);
    if (tile.number !== undefined && at + points * 6 <= rows.length) spark(tile.spark, rows.subarray(at, at + points * 6), points);
  }
}

// What nobody looks at is not asked for.
function follow(on) {
  for (const [topic, take] of [["rates", rates], ["bias", biases]]) on ? watch(topic, take) : unwatch(topic);
}

function head(now) {
  const needs = now.tiles.filter((fields) => fields.needs).length;
  say(document.querySelector('[data-f="count"]'), now.count);
  say(document.querySelector('[data-f="needs"]'), String(needs));
  document.title = now.title;
  trouble(now.troubles);
  alerts(now);
  document.getElementById("none").hidden = now.of > 0;
  if (wall) wide(now.of);
  chips(now.counts);
  share(now.counts, now.of);
}

function chips(counts) {
  const place = document.getElementById("counts");
  for (const state of only) if (state !== "needs" && !counts.some(([one]) => one === state)) only.delete(state); // there is none such
  const shown = counts.filter(([state, , n]) => n || only.has(state));
  for (const chip of [...place.children]) if (!shown.some(([state]) => state === chip.dataset.only)) chip.remove();
  shown.forEach(([state, name, n, words], i) => {
    let chip = [...place.children].find((one) => one.dataset.only === state);
    if (!chip) {
      chip = document.createElement("button");
      chip.type = "button";
      chip.className = "chip";
      chip.dataset.only = state;
      chip.dataset.tone = name;
      chip.setAttribute("aria-pressed", String(only.has(state)));
      const word = document.createElement("span");
      word.textContent = words;
      chip.append(shape(name), word, " ", document.createElement("b"));
    }
    if (place.children[i] !== chip) place.insertBefore(chip, place.children[i] ?? null);
    say(chip.querySelector("b"), String(n));
  });
}

// A wall screen shows all devices at once: in columns of tiles twice as wide as high, in the largest letters that cut nothing.
const wall = document.body.classList.contains("wall"), LEAST_PX = 8, MOST_PX = 40, STEP = 1.05;
let letters = LEAST_PX;
function wide(n) {
  const columns = Math.max(1, Math.ceil(Math.sqrt((n * innerWidth) / (2.2 * innerHeight)))), most = Math.min(MOST_PX, innerWidth / columns / 14);
  const size = (px) => { letters = px; list.style.fontSize = `${px}px`; };
  const cut = () => [...list.children].some((tile) => tile.scrollHeight > tile.clientHeight);
  list.style.setProperty("--columns", columns);
  while (letters < most && !cut()) size(letters * STEP);
  while (letters > LEAST_PX && (letters > most || cut())) size(letters / STEP);
}
// Its clock stands still when the screen does.
const clock = document.getElementById("clock"), tick = () => { clock.textContent = new Date().toLocaleTimeString(document.documentElement.lang, { hour12: false }); };
if (wall) {
  wide(list.children.length);
  addEventListener("resize", () => wide(list.children.length));
  tick();
  setInterval(tick, 1000);
}

function share(counts, of) {
  const picture = document.querySelector(".share");
  let x = 0;
  const parts = counts.filter(([, , n]) => n).reverse().map(([, name, n]) => {
    const part = document.createElementNS("http://www.w3.org/2000/svg", "rect");
    part.dataset.tone = name;
    part.setAttribute("x", x / of);
    part.setAttribute("width", n / of);
    part.setAttribute("height", 1);
    x += n;
    return part;
  });
  picture.replaceChildren(...parts);
}

// ---- what is shown, in which order ----

const EMPTIEST = new Set(["calibrated_ns", "battery_percent"]);

function arrange() {
  keep({ only, find: find.value.trim(), order: order.value });
  if (!page) return;
  const word = find.value.trim().toLowerCase(), by = order.value;
  const rows = [...page.tiles];
  if (by === "id") rows.sort((a, b) => a.id.localeCompare(b.id));
  else if (by) {
    const worst = EMPTIEST.has(by) ? Infinity : -Infinity, sign = EMPTIEST.has(by) ? 1 : -1;
    rows.sort((a, b) => sign * ((a[by] ?? worst) - (b[by] ?? worst)) || 0);
  }
  let after = null;
  for (const fields of rows) {
    const element = tiles.get(fields.id).element;
    const hide = (word && !fields.id.includes(word)) || (only.size > 0 && !only.has(fields.state) && !(only.has("needs") && fields.needs));
    if (element.hidden !== hide) element.hidden = hide;
    const place = after ? after.nextElementSibling : list.firstElementChild;
    if (place !== element && !element.contains(document.activeElement)) list.insertBefore(element, place);
    after = element;
  }
  const shown = rows.filter((fields) => !tiles.get(fields.id).element.hidden).length, unlike = document.getElementById("unlike");
  unlike.hidden = shown === rows.length;
  unlike.classList.toggle("some", shown > 0);
  const { none, some } = unlike.dataset;
  if (!unlike.hidden) say(unlike.firstElementChild, shown ? some.replace("{shown}", shown).replace("{of}", rows.length) : none);
}

document.querySelector(".choose").addEventListener("click", (event) => {
  const chip = event.target.closest("[data-only]");
  if (!chip) return;
  const on = chip.getAttribute("aria-pressed") !== "true";
  chip.setAttribute("aria-pressed", String(on));
  only[on ? "add" : "delete"](chip.dataset.only);
  arrange();
});
document.querySelector(".choose").addEventListener("submit", (event) => event.preventDefault());
document.getElementById("all").addEventListener("click", () => {
  find.value = "";
  only.clear();
  for (const chip of document.querySelectorAll("[data-only]")) chip.setAttribute("aria-pressed", "false");
  arrange();
});
find.addEventListener("input", arrange);
order.addEventListener("change", arrange);
pause.addEventListener("click", () => pause.setAttribute("aria-pressed", String(pause.getAttribute("aria-pressed") !== "true")));
if (matchMedia("(prefers-reduced-motion: reduce)").matches) pause.click();
const numbers = document.getElementById("numbers");
follow(numbers.getAttribute("aria-pressed") === "true");
numbers.addEventListener("click", () => {
  const on = numbers.getAttribute("aria-pressed") !== "true";
  numbers.setAttribute("aria-pressed", String(on));
  list.classList.toggle("plain", !on);
  showNumbers(on);
  pause.hidden = !on;
  follow(on);
  for (const tile of tiles.values()) tile.strip.size();
});
addEventListener("resize", () => tiles.forEach((tile) => tile.strip.size()));

// ---- what is told to those who cannot see it ----

// From what the server wrote on: what has changed before the first frame came is told too.
let words = new Map([...list.children].map((element) => [element.dataset.id, element.querySelector('[data-f="word"]').textContent]));
function tell(now) {
  const news = now.tiles.filter((fields) => words.get(fields.id) !== fields.word).map((fields) => `${fields.id}: ${fields.word}`);
  if (news.length) say(document.getElementById("told"), news.slice(0, 5).join(". "));
  words = new Map(now.tiles.map((fields) => [fields.id, fields.word]));
}

// The page of one device: words once a second, rates as they come.

import { chart, post, stripe } from "./charts.js";
import { fill, tone } from "./fields.js";
import { say, spoken, trouble, unwatch, watch } from "./live.js";

const AXES = ["x", "y", "z"], WINDOW_S = 20, BACK_S = 1, PAUSE_S = 0.5; // no line leads across a longer pause
const page = document.querySelector(".device"), id = page.dataset.id;
const $ = (name) => document.getElementById(name);
let trail = { rests: [], marks: [] };

// ---- words ----

watch(spoken(`device/${id}`), (now) => {
  fill(page, now.tile);
  $("guide").hidden = !now.can_calibrate;
  say($("guide").firstElementChild, now.guide);
  $("guide").firstElementChild.classList.toggle("quiet", !now.tile.calibrate);
  tone(page, now.tile.tone);
  $("progress").value = now.progress;
  document.title = now.title;
  trouble(now.troubles);
  if ($("recalibrate")) $("recalibrate").hidden = !now.can_recalibrate;
  if ($("cancel")) $("cancel").hidden = !now.can_cancel;
  if ($("blocked")) say($("blocked"), now.blocked || (now.can_recalibrate ? page.dataset.hint : ""));
  if (told !== now.tile.word) { if (told) say($("told"), `${id}: ${now.tile.word}. ${now.tile.reason}`); told = now.tile.word; }
  rows("calibrations", now.calibrations, ([used, [when, ...cells]]) => [when + (used ? ` ${page.dataset.inUse}` : ""), ...cells], ([used]) => used);
  for (const name of ["boots", "notes", "events"]) rows(name, now[name], (line) => line);
  facts(now.facts);
}, { must: true });
let told = page.querySelector('[data-f="word"]').textContent;

const shown = {};
function rows(name, lines, cells, used = () => false) {
  const key = JSON.stringify(lines);
  document.querySelector(`[data-none="${name}"]`).hidden = lines.length > 0;
  $(name).hidden = lines.length === 0;
  if (shown[name] === key) return;
  shown[name] = key;
  const headings = [...$(name).tHead.rows[0].cells].map((cell) => cell.textContent);
  $(name).tBodies[0].replaceChildren(...lines.map((line) => {
    const row = document.createElement("tr");
    row.classList.toggle("in-use", used(line));
    cells(line).forEach((words, i) => {
      const cell = row.insertCell();
      cell.dataset.is = headings[i];
      cell.textContent = words;
    });
    return row;
  }));
}

function facts(pairs) {
  const place = $("facts");
  if (place.children.length !== pairs.length || [...place.children].some((one, i) => one.firstElementChild.textContent !== pairs[i][0]))
    place.replaceChildren(...pairs.map(([name]) => {
      const pair = document.createElement("div");
      pair.append(Object.assign(document.createElement("dt"), { textContent: name }), document.createElement("dd"));
      return pair;
    }));
  pairs.forEach(([, value], i) => say(place.children[i].lastElementChild, value));
}

// ---- rates ----

const rates = AXES.map((axis) => chart($("rates"), {
  label: $("rates").dataset.label.replace("{axis}", axis), title: `${axis}, °/s`, height: axis === "z" ? 172 : 150, clock: false, times: axis === "z",
  series: [{ label: page.dataset.asRead, colour: "raw", dash: [3, 3], width: 2 }, { label: page.dataset.corrected, colour: axis }],
}));
const columns = { time: [], raw: [[], [], []], corrected: [[], [], []] };
const all = [columns.time, ...columns.raw, ...columns.corrected];
let newest = 0;

const pause = $("pause");
pause.addEventListener("click", () => {
  const on = pause.getAttribute("aria-pressed") !== "true";
  pause.setAttribute("aria-pressed", String(on));
});

function trace(data) {
  if (!(data instanceof ArrayBuffer)) { heading(data); return; }
  const n = data.byteLength / 44, time = new Float64Array(data, 0, n), rest = new Float32Array(data, 8 * n);
  for (let i = 0; i < n; i++) {
    if (time[i] <= newest - BACK_S) for (const column of all) column.length = 0; // the host's clock was set back, or is another's
    else if (time[i] <= newest) continue;
    if (newest && time[i] - newest > PAUSE_S) { columns.time.push(newest + 0.001); for (const column of all.slice(1)) column.push(null); }
    newest = time[i];
    columns.time.push(time[i]);
    for (let axis = 0; axis < 3; axis++) {
      columns.raw[axis].push(number(rest[3 * i + axis]));
      columns.corrected[axis].push(number(rest[3 * (n + i) + axis]));
    }
  }
  let old = 0;
  while (old < columns.time.length && columns.time[old] < newest - WINDOW_S) old++;
  for (const column of all) column.splice(0, old);
  due = true;
}

// Signals and receipts are asked for while somebody looks at them.
const asked = { signals: [[`trace/${id}`, trace], [`trail/${id}`, past]], engineering: [[spoken(`receipts/${id}`), receipts]] };
for (const depth of document.querySelectorAll("details.depth")) {
  const look = () => { for (const [topic, take] of asked[depth.id]) depth.open ? watch(topic, take) : unwatch(topic); };
  depth.open ||= location.hash === `#${depth.id}`; // somebody may have opened it before this script ran
  depth.addEventListener("toggle", look);
  look();
}

let due = false;
function frame() {
  if (due && pause.getAttribute("aria-pressed") !== "true") {
    due = false;
    if ($("rates").hidden) { $("rates").hidden = pause.hidden = false; $("waiting").hidden = true; }
    const ago = columns.time.map((time) => time - newest);
    rates.forEach((one, axis) => one.set([ago, columns.raw[axis], columns.corrected[axis]]));
  }
  requestAnimationFrame(frame);
}
requestAnimationFrame(frame);

const number = (value) => (Number.isNaN(value) ? null : value);

// ---- heading ----

const headings = chart($("headings"), {
  label: $("headings").dataset.label, title: "°", height: 150,
  series: [{ label: page.dataset.asRead, colour: "raw", width: 2.5, dash: [3, 3] }, { label: page.dataset.zeroed, colour: "y", width: 2 },
    { label: "+σ", colour: "z" }, { label: "−σ", colour: "z" }],
  bands: [[3, 4, "z"]], range: (u, low, high) => [Math.min(-0.5, low * 1.05), Math.max(0.5, high * 1.05)],
});

function heading(now) {
  const { points } = now, [, read, zeroed, std] = now.now;
  headings.figure.hidden = points.length < 2;
  headings.set([0, 1, 2, 3].map((i) => points.map((p) => p[i])).concat([points.map((p) => -p[3])]));
  if (!now.since) return;
  const size = (value, digits) => Math.abs(value).toFixed(digits);
  const values = { since: now.since, read: size(read, 1), zeroed: size(zeroed, 1), std: size(std, 2), turned: size(now.turned, 1) };
  const words = $("heading").dataset[now.vertical ? "heading" : "attitude"].replace(/\{(\w+)\}/g, (_, name) => values[name]);
  say($("heading"), words);
  headings.figure.setAttribute("aria-label", words);
}

// ---- bias and temperature ----

function happenings(u) {
  for (const [from, to] of trail.rests) stripe(u, from, to, "well", 0.6);
  let last = -Infinity; // of the mark drawn last
  for (const [at, kind] of [...trail.marks].sort(([a], [b]) => a - b)) {
    if (kind !== "calibrated" && last !== -Infinity && !apart(u, at, last)) continue;
    last = at;
    post(u, at, kind === "calibrated" ? "well" : kind === "note" ? "busy" : "ask");
  }
}
// Of marks closer than a finger's width of pixels one stands for all: days are no solid block.
const MARKS_PX = 12;
const apart = (u, at, last) => Math.abs(u.valToPos(at, "x") - u.valToPos(last, "x")) > MARKS_PX;
// How unsure it once was is not to hide what it is now: intervals far wider than the present one run out of the picture.
function around(u) {
  const [, value, high] = u.data;
  let last = value.length - 1;
  while (last >= 0 && value[last] === null) last--;
  if (last < 0) return [-1, 1];
  const most = Math.max(6 * (high[last] - value[last]), 0.002);
  let low = Infinity, top = -Infinity;
  for (let i = 0; i <= last; i++) {
    if (value[i] === null || high[i] - value[i] > 20 * most) continue;
    const room = Math.min(high[i] - value[i], most);
    low = Math.min(low, value[i] - room);
    top = Math.max(top, value[i] + room);
  }
  return [low - 0.08 * (top - low), top + 0.08 * (top - low)];
}

const biases = AXES.map((axis) => chart($("biases"), {
  label: $("biases").dataset.label.replace("{axis}", axis), title: `${axis}, °/s`, height: axis === "z" ? 152 : 130, times: axis === "z", behind: happenings, range: around,
  series: [{ label: "b", colour: axis, width: 2 }, { label: "+2σ", colour: axis, width: 0 }, { label: "−2σ", colour: axis, width: 0 }],
  bands: [[2, 3, axis]],
}));
const temperatures = chart($("temperatures"), {
  label: $("temperatures").dataset.label, title: "°C", height: 120, behind: happenings, series: [{ label: "°C", colour: "y", width: 2 }],
  range: (u, low, high) => (low === null ? [0, 1] : [Math.min(low, high - 1) - 0.2, high + 0.2]),
});

function past(data) {
  if (!(data instanceof ArrayBuffer)) { trail = data; return; }
  const n = data.byteLength / 36, time = Array.from(new Float64Array(data, 0, n)), rest = new Float32Array(data, 8 * n);
  const column = (i, map = (v) => v) => time.map((_, row) => number(map(rest[7 * row + i], row)));
  AXES.forEach((_, axis) => biases[axis].set([time, column(axis), column(axis, (v, row) => v + 2 * rest[7 * row + 3 + axis]), column(axis, (v, row) => v - 2 * rest[7 * row + 3 + axis])]));
  for (const one of biases) one.figure.hidden = n < 2;
  const celsius = column(6);
  $("warmth").hidden = celsius.every((value) => value === null);
  temperatures.set([time, celsius]);
}

// ---- receipts of the bias filter ----

const nis = chart($("nis"), {
  label: $("nis").dataset.label, title: "NIS", height: 160, range: (u, low, high) => [0, Math.max(3, high * 1.1)],
  series: [{ label: "1", colour: "dim", dash: [6, 4] }, { label: "✓", colour: "well", dots: true }, { label: "✗", colour: "bad", dots: true }],
});

function receipts(now) {
  say($("filter").lastElementChild, now.verdict);
  tone($("filter"), now.tone);
  rows("receipts", now.lines, (line) => line);
  say($("nis-mean"), now.mean);
  $("nis").closest("section").hidden = now.points.length < 2; // nothing to draw, nothing to explain
  nis.figure.setAttribute("aria-label", `${$("nis").dataset.label}. ${now.mean}`);
  const of = (wanted) => now.points.map(([, value, accepted]) => (accepted === wanted ? value : null));
  nis.set([now.points.map(([at]) => at), now.points.map(() => 1), of(true), of(false)]);
}

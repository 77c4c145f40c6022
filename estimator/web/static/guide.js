// The guide: what the server tells, shown; a new step is announced once, when it has lasted a moment.

import { say, trouble, watch } from "./live.js";

const CALM_MS = 400, OVER = new Set(["idle", "done", "cancelled", "away", "broken", "refused"]);
const page = document.querySelector(".guide"), id = page.dataset.id, language = document.documentElement.lang;
const $ = (name) => document.getElementById(name);
const title = document.title;
let before = null; // the step of the last frame: the server wrote the page by a guide that may not know how it came to it

watch(`guide/${id}`, (now) => {
  const said = now.say[language], how = now.step === "idle" && now.tone === "well" && page.dataset.idle ? page.dataset.idle : said.how;
  page.dataset.tone = now.tone;
  if (before !== null && before !== now.step) document.getElementById("said")?.remove(); // an answer is of the step before
  page.dataset.step = before = now.step;
  awake(!OVER.has(now.step));
  say($("do"), said.head);
  say($("how"), how);
  lines($("wrong").lastElementChild, said.wrong);
  $("wrong").hidden = !said.wrong.length;
  say($("rebooted"), said.rebooted);
  $("rebooted").hidden = !said.rebooted;
  picture(now);
  ring(now, said);
  turns(said.turns);
  if ($("begin")) $("begin").hidden = !now.can_begin;
  if ($("cancel")) $("cancel").hidden = !now.can_cancel;
  if ($("log-in")) {
    const link = $("log-in").firstElementChild;
    $("log-in").hidden = !(now.can_begin || now.can_cancel);
    say(link, now.can_cancel ? link.dataset.cancel : link.dataset.begin);
  }
  following(now);
  result(now, said);
  trouble(said.troubles);
  document.title = `${said.head} · ${title}`;
  announce(sentences(said.rebooted, said.wrong, said.head, how));
}, { must: true });

function lines(place, words) {
  if (place.textContent === words.join("")) return;
  place.replaceChildren(...words.map((one) => Object.assign(document.createElement("p"), { textContent: one })));
}

function picture(now) {
  for (const one of $("pictures").children) {
    one.toggleAttribute("hidden", one.dataset.picture !== now.picture);
    for (const way of one.querySelectorAll("[data-way]")) way.toggleAttribute("hidden", Number(way.dataset.way) !== (now.way || Number(one.dataset.usual)));
  }
}

function ring(now, said) {
  $("part").setAttribute("stroke-dasharray", `${now.percent} 200`);
  say($("centre"), now.centre);
  $("ring").setAttribute("aria-valuenow", now.percent);
  $("ring").setAttribute("aria-valuetext", said.progress);
}

// After the last turn the next device is one touch away.
function following(now) {
  const link = $("next").firstElementChild, over = now.step === "done" || now.step === "idle";
  $("next").hidden = !over || !now.following;
  $("back").hidden = now.step !== "done" || now.tone !== "well" || Boolean(now.following);
  link.href = `/devices/${encodeURIComponent(now.following)}/calibrate`;
  say(link, link.dataset.words.replace("{device}", now.following));
}

let shown = "";
function turns(all) {
  const key = JSON.stringify(all);
  if (key === shown) return;
  shown = key;
  $("turns").replaceChildren(...all.map((turn) => {
    const line = document.createElement("li"), axis = document.createElement("span"), how = document.createElement("span"), state = document.createElement("b");
    line.dataset.mark = turn.mark;
    axis.className = "axis-name";
    [axis.textContent, how.textContent, state.textContent] = [turn.axis, turn.how, turn.state];
    line.append(axis, " ", how, " ", state);
    return line;
  }));
}

function result(now, said) {
  $("result").hidden = !now.result.length;
  if (!now.result.length) return;
  say($("compared"), said.compared);
  $("certificate").href = `/devices/${encodeURIComponent(id)}/calibrations/${encodeURIComponent(now.calibration)}/certificate`;
  if ($("rows").dataset.of === now.calibration) return;
  $("rows").dataset.of = now.calibration;
  $("compare").classList.toggle("first", !now.result.some((row) => row.before));
  $("rows").replaceChildren(...now.result.map((row) => {
    const line = document.createElement("tr"), axis = document.createElement("th");
    axis.scope = "row";
    axis.textContent = row.axis;
    line.append(axis);
    for (const value of [row.scale, row.before, row.bias]) line.insertCell().textContent = value;
    return line;
  }));
}

// ---- nobody touches the screen while hands are busy: it must not go dark ----

let lock = null, wanted = false;
async function awake(on) {
  if (on === wanted) return;
  wanted = on;
  if (!on) { lock?.release(); lock = null; return; }
  try {
    lock = await navigator.wakeLock?.request("screen") ?? null; // only where the page is secure
    lock?.addEventListener("release", () => { lock = null; });
  } catch { lock = null; }
}

document.addEventListener("visibilitychange", () => {
  if (document.hidden || !wanted) return;
  wanted = false;
  awake(true);
});

// ---- what is told to those who cannot see it ----

const sentences = (...all) => all.flat().filter(Boolean).map((one) => one.trim().replace(/[.。]?$/, ".")).join(" ");
// What the server wrote is read with the page; from there on everything new is told.
const lines_of = [...$("wrong").lastElementChild.children].map((one) => one.textContent);
let last = sentences($("rebooted").textContent, lines_of, $("do").textContent, $("how").textContent), waiting = 0;
function announce(words) {
  if (words === last) return;
  last = words;
  clearTimeout(waiting);
  waiting = setTimeout(() => say($("told"), words), CALM_MS);
}

// The device as it lies and turns: a box seen from the south, a little from above, with the band of its heading (of its x) on the floor.

import { say, watch } from "./live.js";

const STALE_MS = 3000, CALM_MS = 1000; // without news the picture goes; who wants little motion sees it move once a second
const figure = document.getElementById("attitude"), id = document.querySelector(".device").dataset.id;
const sensor = figure.querySelector(".sensor"), floor = figure.querySelector(".floor");
const calm = matchMedia("(prefers-reduced-motion: reduce)");
let last = 0, gone;

watch(`attitude/${id}`, (now) => {
  clearTimeout(gone);
  gone = setTimeout(() => { figure.hidden = true; }, STALE_MS);
  if (calm.matches && performance.now() - last < CALM_MS) return;
  last = performance.now();
  sensor.style.transform = matrix(now.quat_wxyz);
  floor.style.setProperty("--from", `${90 - now.heading - now.heading_band}deg`);
  floor.style.setProperty("--wide", `${Math.min(2 * now.heading_band, 360)}deg`);
  const words = figure.dataset.words.replace(/\{(\w+)\}/g, (_, name) => now[name].toFixed(1));
  if (figure.hidden) figure.hidden = false;
  say(document.getElementById("attitude-words"), words);
  figure.setAttribute("aria-label", words);
});

// The screen's axes are right, down and towards the viewer; the earth's are east (right), north (away) and up.
function matrix([w, x, y, z]) {
  const r = [
    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
  ];
  const order = [0, 2, 1], sign = [1, -1, -1];
  const on = (i, j) => sign[i] * sign[j] * r[order[i]][order[j]];
  const columns = [0, 1, 2].map((j) => [0, 1, 2].map((i) => on(i, j)).concat(0).join(","));
  return `matrix3d(${columns.join(",")},0,0,0,1)`;
}

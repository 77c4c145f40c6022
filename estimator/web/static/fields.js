// Fills [data-f] of an element with the fields of a tile, as text; [data-of] is hidden where the field is empty.

import { say } from "./live.js";

export function fill(element, fields) {
  for (const at of element.querySelectorAll("[data-f]")) {
    const value = fields[at.dataset.f];
    if (value !== undefined) say(at, String(value));
  }
  for (const at of element.querySelectorAll("[data-of]")) {
    const empty = !fields[at.dataset.of];
    if (at.hidden !== empty && at.dataset.of in fields) at.hidden = empty;
  }
}

export function tone(element, name) {
  if (element.dataset.tone === name) return;
  element.dataset.tone = name;
  element.querySelector(".shape use")?.setAttribute("href", `/static/shapes.svg#${name}`);
}

export function shape(name) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("class", "shape");
  svg.setAttribute("viewBox", "0 0 24 24");
  svg.setAttribute("aria-hidden", "true");
  svg.append(document.createElementNS("http://www.w3.org/2000/svg", "use"));
  svg.firstChild.setAttribute("href", `/static/shapes.svg#${name}`);
  return svg;
}

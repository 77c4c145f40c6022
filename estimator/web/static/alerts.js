// The standing alerts above the tiles, and their sound: off until somebody switches it on, as browsers want a touch first.

import { fill } from "./fields.js";

const place = document.getElementById("alerts"), list = place.querySelector("ul"), template = document.getElementById("alert");
const sound = document.getElementById("sound"), AGAIN_MS = 10000, BEEPS = [880, 660];
let audio = null, alarm = false;

export function alerts(now) {
  const before = alarm;
  alarm = now.alarm;
  if (alarm && !before) beep();
  place.hidden = now.alerts.length === 0;
  const there = new Map([...list.children].map((element) => [element.dataset.alert, element]));
  for (const one of now.alerts) {
    const id = `${one.subject}/${one.kind}`, element = there.get(id) ?? template.content.firstElementChild.cloneNode(true);
    there.delete(id);
    element.dataset.alert = id;
    fill(element, one);
    const form = element.querySelector("form");
    if (form) {
      form.setAttribute("action", `/devices/${one.subject}/acknowledge`);
      form.elements.words.value = one.kind;
      form.hidden = one.seen !== "";
    }
    if (!element.isConnected) list.append(element);
  }
  for (const element of there.values()) element.remove();
}

function beep() {
  if (!audio || !alarm) return;
  BEEPS.forEach((hertz, i) => {
    const tone = audio.createOscillator(), begin = audio.currentTime + 0.3 * i;
    tone.frequency.value = hertz;
    tone.connect(audio.destination);
    tone.start(begin);
    tone.stop(begin + 0.25);
  });
}

sound.addEventListener("click", () => {
  const on = sound.getAttribute("aria-pressed") !== "true";
  sound.setAttribute("aria-pressed", String(on));
  if (on) { audio = new AudioContext(); beep(); } else { audio.close(); audio = null; }
});
setInterval(beep, AGAIN_MS);

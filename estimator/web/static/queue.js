// Several devices are calibrated at once: the first of those that wait, each with its one next step. A finished one makes room.

import { say, spoken, trouble, unwatch, watch } from "./live.js";

const AT_ONCE = 6, STAYS_MS = 6000, OVER = new Set(["done", "idle", "cancelled"]);
const list = document.getElementById("queue"), template = document.getElementById("card"), language = document.documentElement.lang;
const others = document.getElementById("waiting"), leaving = new Map();
const cards = new Map([...list.children].map((card) => [card.dataset.id, card]));
for (const [id, card] of cards) follow(id, card);

function follow(id, card) {
  watch(`guide/${id}`, (now) => {
    const said = now.say[language], wrong = card.querySelector(".wrong");
    card.dataset.tone = now.tone;
    card.dataset.step = now.step;
    say(card.querySelector(".do"), said.head);
    say(wrong, said.wrong[0] ?? ""); // the others are on the guide of the device
    wrong.hidden = !said.wrong.length;
    card.querySelector("progress").value = OVER.has(now.step) ? 100 : now.percent;
  });
}

watch(spoken("ward"), (now) => {
  trouble(now.troubles);
  for (const [id, card] of cards) {
    if (now.queue.includes(id)) { leaving.delete(id); continue; }
    if (!leaving.has(id)) leaving.set(id, performance.now());
    if (performance.now() - leaving.get(id) < STAYS_MS) continue; // its "Done" is read
    unwatch(`guide/${id}`);
    card.remove();
    cards.delete(id);
    leaving.delete(id);
  }
  for (const id of now.queue) {
    if (cards.size >= AT_ONCE || cards.has(id)) continue;
    const card = template.content.firstElementChild.cloneNode(true), link = card.querySelector("a");
    card.dataset.id = link.textContent = id;
    link.href = `/devices/${encodeURIComponent(id)}/calibrate`;
    list.append(card);
    cards.set(id, card);
    follow(id, card);
  }
  const rest = now.queue.filter((id) => !cards.has(id));
  others.hidden = !rest.length;
  say(others, others.dataset.words.replace("{names}", rest.join(", ")));
  const waits = now.queue.length > 0;
  document.getElementById("nobody").hidden = waits;
  document.getElementById("how").hidden = !waits && !cards.size;
  document.querySelector(".to-ward a").classList.toggle("quiet", waits);
}, { must: true });

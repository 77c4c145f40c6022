// What the reader has chosen to see: in the address, so that it can be loaded again and passed on; in this tab it outlives a look
// at a device.

const KEY = "truerate-choice", NAMES = ["only", "find", "order"], WALL = new URLSearchParams(location.search).get("wall"), YEAR_S = 365 * 86400;
const asked = new URLSearchParams(location.search);
const from = NAMES.some((name) => asked.has(name)) ? asked : new URLSearchParams(sessionStorage.getItem(KEY) ?? "");

export const chosen = {
  only: new Set((from.get("only") ?? "").split(",").filter(Boolean)),
  find: from.get("find") ?? "",
  order: from.get("order") ?? "",
};

let kept = null;
export function keep({ only, find, order }) {
  const query = new URLSearchParams(Object.entries({ only: [...only].join(","), find, order, wall: WALL }).filter(([, value]) => value)).toString();
  if (query === kept) return;
  kept = query;
  sessionStorage.setItem(KEY, query);
  history.replaceState(null, "", query ? `?${query}` : location.pathname);
}

// A cookie, so that the server writes the next page as it was left.
export function showNumbers(on) {
  document.cookie = `truerate-numbers=${on ? 1 : 0}; path=/; samesite=lax; max-age=${YEAR_S}`;
}

// What is around the picture: dark, mid-grey or light. A picture looks brighter beside dark, and darker beside light.

export const SURROUNDS = [
  ["dark", "Dark"],
  ["grey", "Grey"],
  ["light", "Light"],
];
const KEY = "relight-surround";

/** The surround that was chosen last in this browser; otherwise the one that the system's colour scheme suggests. */
export function preferredSurround() {
  let kept = null;
  try {
    kept = localStorage.getItem(KEY);
  } catch {
    // The browser keeps nothing for this page.
  }
  if (SURROUNDS.some(([name]) => name === kept)) return kept;
  return matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark";
}

/** Shows a surround in these elements; `keep`: the next page begins with it. */
export function surround(elements, name, keep = false) {
  for (const element of elements) element.dataset.surround = name;
  if (!keep) return;
  try {
    localStorage.setItem(KEY, name);
  } catch {
    // As above.
  }
}

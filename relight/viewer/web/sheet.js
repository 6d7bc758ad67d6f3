// On a phone the panel is a sheet that is pulled up from below the picture, or out from beside it.

import { h } from "./dom.js";
import { clamp } from "./lights.js";

const BESIDE = "(orientation: landscape)"; // where the panel is beside the picture
const LEVELS = ["low", "middle", "high"];
const TAP = 6; // CSS pixels of motion below which a press is a tap

/** The grip of a panel, a button: drag it, tap it, or use the arrow keys. It sets `data-sheet` of the viewer's root. */
export function grip(viewer) {
  const { root } = viewer;
  const bar = h("button", { type: "button", class: "grip" }, h("i", { "aria-hidden": "true" }));
  const level = () => LEVELS.indexOf(root.dataset.sheet);
  const beside = () => matchMedia(BESIDE).matches;
  const set = (index) => {
    root.dataset.sheet = LEVELS[clamp(index, 0, LEVELS.length - 1)];
    root.style.removeProperty("--pulled");
    const shrinks = level() === LEVELS.length - 1;
    bar.setAttribute("aria-label", shrinks ? "Make the panel smaller" : "Make the panel larger");
    bar.setAttribute("aria-expanded", String(level() > 0));
  };
  const pulled = (event) => {
    const bounds = root.getBoundingClientRect();
    return beside() ? [bounds.right - event.clientX, bounds.width] : [bounds.bottom - event.clientY, bounds.height];
  };
  let began = null;
  bar.addEventListener("pointerdown", (event) => {
    bar.setPointerCapture(event.pointerId);
    began = { at: pulled(event)[0], moved: false };
  });
  bar.addEventListener("pointermove", (event) => {
    if (!began) return;
    const [size, whole] = pulled(event);
    began.moved ||= Math.abs(size - began.at) > TAP;
    if (began.moved) root.style.setProperty("--pulled", `${clamp(size, 24, 0.85 * whole)}px`);
  });
  bar.addEventListener("pointerup", (event) => {
    const [size, whole] = pulled(event);
    if (began?.moved) set(size < 0.25 * whole ? 0 : size < 0.6 * whole ? 1 : 2);
    bar.dragged = began?.moved;
    began = null;
  });
  bar.addEventListener("pointercancel", () => {
    began = null;
    set(level());
  });
  bar.addEventListener("click", () => {
    if (!bar.dragged) set((level() + 1) % LEVELS.length);
    bar.dragged = false;
  });
  bar.addEventListener("keydown", (event) => {
    const step = { ArrowUp: 1, ArrowLeft: 1, ArrowDown: -1, ArrowRight: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    event.stopPropagation();
    set(level() + step);
  });
  bar.raise = () => level() === 0 && set(1);
  set(1);
  return bar;
}

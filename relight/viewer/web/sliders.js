// Sliders with their number beside them.

import { h } from "./dom.js";
import { clamp } from "./lights.js";
import { RANGES } from "./state.js";

/** A slider of stops. */
export const STOPS = { min: -6, max: 6, step: 0.05, unit: "stops" };

/**
 * A labelled slider with its number beside it.
 * `place` and `value`: from the value to the slider's place and back, if they differ; `neutral`: what a double click
 * sets; `off`: the text of an unset value, null, where there may be none.
 */
export function slider({
  label,
  min,
  max,
  step,
  unit = "",
  digits = 2,
  neutral = 0,
  off = null,
  place = (v) => v,
  value = (p) => p,
  onchange,
  onend,
}) {
  const range = h("input", { type: "range", min, max, step, "aria-label": label });
  const number = h("input", { type: "text", inputmode: "decimal", class: "number", "aria-label": `${label}, exactly` });
  const units = h("span", { class: "unit" }, unit);
  const row = h(
    "div",
    { class: "slider" },
    h("span", { class: "label" }, label),
    range,
    h("span", { class: "value" }, number, units),
  );
  range.addEventListener("input", () => onchange(value(Number(range.value))));
  range.addEventListener("change", () => onend());
  range.addEventListener("dblclick", () => (onchange(off ? null : neutral), onend()));
  number.addEventListener("focus", () => number.select());
  number.addEventListener("change", () => {
    const text = number.value.trim();
    const given = Number(text.replace(",", ".").replace("−", "-"));
    if (off && (text === "" || text.toLowerCase() === off)) onchange(null);
    else if (text !== "" && Number.isFinite(given)) onchange(given);
    onend();
  });
  row.set = (current) => {
    const unset = current === null;
    const text = unset ? off : written(current, digits);
    range.value = place(unset ? neutral : current);
    range.style.setProperty("--at", `${(100 * (range.value - min)) / (max - min)}%`);
    range.setAttribute("aria-valuetext", unset ? off : `${text} ${unit}`);
    row.classList.toggle("unset", unset);
    units.textContent = unset ? "" : unit;
    if (number.getRootNode().activeElement !== number) number.value = text;
  };
  return row;
}

const written = (value, digits) => Number(value.toFixed(digits)).toString().replace("-", "−");

/**
 * A slider of what `owner` picks from a viewer's state. Numbers that are typed may be beyond its ends: from `low` to
 * `high`, or in the range of the light's parameter.
 */
export function bound(viewer, label, key, owner, options) {
  const control = slider({
    label,
    ...options,
    onchange: (given) => {
      const [low, high] = options.limits?.(owner(viewer.state)) ?? [
        options.low ?? RANGES[key]?.[0] ?? options.min,
        options.high ?? RANGES[key]?.[1] ?? options.max,
      ];
      const value = given === null ? null : clamp(given, low, high);
      viewer.change((state) => owner(state) && (owner(state)[key] = value), `${label}${viewer.state.selected}`);
    },
    onend: () => viewer.endGesture(),
  });
  control.refresh = (state) => owner(state) && control.set(owner(state)[key]);
  return control;
}

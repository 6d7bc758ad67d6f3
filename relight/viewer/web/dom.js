// Elements in few words. What comes from outside is always set as text, never as markup.

/** An element: attributes by name, listeners as `onclick`, and children, elements or texts. */
export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (value !== null && value !== undefined && value !== false)
      element.setAttribute(key, value === true ? "" : value);
  }
  element.append(...children);
  return element;
}

const ICONS = {
  undo: "M9 14 4 9l5-5M4 9h10a6 6 0 0 1 0 12h-3",
  redo: "m15 14 5-5-5-5M20 9H10a6 6 0 0 0 0 12h3",
  add: "M12 5v14M5 12h14",
  delete: "M6 6l12 12M18 6 6 18",
  play: "M8 5v14l11-7z",
  help: "M9.2 9a3 3 0 1 1 4.4 2.7c-1 .6-1.6 1.2-1.6 2.3M12 17.6v.1",
  out: "M12 15V4m0 0L7.5 8.5M12 4l4.5 4.5M5 13v7h14v-7",
};

/** A button with an icon, whose name screen readers say. */
export function iconButton(icon, label, onclick, key = "") {
  const button = h("button", {
    type: "button",
    class: "icon",
    "aria-label": label,
    title: key ? `${label} (${key})` : label,
    onclick,
  });
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 24 24");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  path.setAttribute("d", ICONS[icon]);
  svg.append(path);
  button.append(svg);
  return button;
}

/** A choice of one among few. `options`: [[value, label]]. */
export function choice(name, label, options, onchange) {
  const group = h("div", { class: "choice", role: "radiogroup", "aria-label": label });
  const inputs = options.map(([value, text]) => {
    const input = h("input", { type: "radio", name, value, onchange: () => onchange(value) });
    group.append(h("label", {}, input, h("span", {}, text)));
    return input;
  });
  group.set = (value) => inputs.forEach((input) => (input.checked = input.value === value));
  return group;
}

/** What most people need not see, behind a line that opens it. */
export const more = (label, ...children) =>
  h("details", { class: "more" }, h("summary", { "aria-label": `More: ${label}` }, "More"), ...children);

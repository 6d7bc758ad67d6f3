// All keys, and the sheet that lists them.

import { h } from "./dom.js";

const OF_INPUTS = /^(Arrow|Page|Home|End|Backspace|Delete)/; // keys with which sliders and choices are set
const DRAG = [
  "Drag on the picture",
  "the light follows, on a sphere around the person; beyond the ring it moves behind them",
];
const FINGERS = [
  DRAG,
  ["Pinch, drag two fingers", "zooms and moves the picture"],
  ["Hold Before", "shows the photograph"],
  ["Tap a handle", "selects that light"],
  ["Drag the panel's grip", "shows more of the panel, or more of the picture"],
];
const MOUSE = [
  DRAG,
  ["Wheel", "zooms"],
  ["Drag the right button", "moves the picture once it is zoomed; with Shift it turns the environment"],
  ["Drop a file", "on the picture: the background; on the panel: an environment (.hdr or a picture)"],
  ["Double click a slider", "sets its neutral value"],
];

/** [key as `KeyboardEvent.key` has it, with its modifiers; as people write it; what it does; action]. */
export function keyTable(viewer) {
  const { actions } = viewer;
  const aim = (azimuth, elevation) => (event) =>
    actions.aim(azimuth * (event.shiftKey ? 10 : 1), elevation * (event.shiftKey ? 10 : 1));
  const push = (centimetres) => (event) => actions.push(centimetres * (event.shiftKey ? 10 : 1));
  const look = (name) => () => actions.look(name);
  return [
    ["Lights"],
    ["ArrowLeft", "", "", aim(-1, 0)],
    ["ArrowRight", "", "", aim(1, 0)],
    ["ArrowUp", "← → ↑ ↓", "move the light a degree, or a centimetre; with Shift ten", aim(0, 1)],
    ["ArrowDown", "", "", aim(0, -1)],
    ["d", "D", "near, in the room; and distant again", actions.switch],
    ["PageUp", "Page ↑ ↓", "push a near light away, draw it nearer", push(5)],
    ["PageDown", "", "", push(-5)],
    ["a", "A", "add a light", actions.add],
    ["Delete", "Delete", "delete it", () => actions.remove(viewer.state.selected)],
    ["Backspace", "", "", () => actions.remove(viewer.state.selected)],
    ["digit", "1 – 8", "select a light", (event) => viewer.select(Number(event.key) - 1)],
    ["s", "S", "solo", () => actions.toggle("solo")],
    ["m", "M", "mute", () => actions.toggle("muted")],
    ["+", "+ −", "a quarter of a stop brighter, darker", () => actions.brighten(0.25)],
    ["=", "", "", () => actions.brighten(0.25)],
    ["-", "", "", () => actions.brighten(-0.25)],
    [".", ". ,", "softer, harder", () => actions.soften(1)],
    [",", "", "", () => actions.soften(-1)],
    ["k", "K J", "cooler, warmer", () => actions.warmth(-10)],
    ["j", "", "", () => actions.warmth(10)],
    ["t", "T", "play an orbit, and stop", actions.orbit],
    ["Surroundings"],
    ["r", "R  Shift R", "turn the environment", () => actions.turn(5)],
    ["shift+r", "", "", () => actions.turn(-5)],
    ["e", "E", "mute the environment", actions.muteEnvironment],
    ["g", "G", "the next kind of background", actions.nextBackground],
    ["View"],
    ["p", "P", "picture", look("picture")],
    ["i", "I", "light alone, on a white person", look("light")],
    ["v", "V", "visibility", look("visibility")],
    ["n", "N", "normals", look("normals")],
    ["b", "B", "albedo", look("albedo")],
    ["o", "O", "photograph", look("photograph")],
    [" ", "Space", "hold for the photograph", null],
    ["w", "W", "wipe, on and off; [ ] move it", actions.wipe],
    ["[", "", "", () => actions.moveWipe(-0.02)],
    ["]", "", "", () => actions.moveWipe(0.02)],
    ["x", "X  Shift X", "expose a quarter of a stop more, less", () => actions.expose(0.25)],
    ["shift+x", "", "", () => actions.expose(-0.25)],
    ["z", "Z  Shift Z  0", "zoom in, out; show all", () => viewer.stage.zoom(1.4)],
    ["shift+z", "", "", () => viewer.stage.zoom(0.7)],
    ["0", "", "", () => viewer.stage.fit()],
    ["h", "H", "hide the handles", actions.hide],
    ["Out"],
    ["c", "C", "copy the lights, a lights file", actions.copyLights],
    ["shift+c", "Shift C", "copy the command", actions.copyCommand],
    ["l", "L", "copy a link", actions.copyLink],
    ["ctrl+c", "Ctrl C", "copy the picture", actions.copyPicture],
    ["ctrl+s", "Ctrl S", "save a PNG", actions.save],
    ["ctrl+z", "Ctrl Z", "undo", actions.undo],
    ["ctrl+shift+z", "Ctrl Shift Z", "redo", actions.redo],
    ["ctrl+y", "", "", actions.redo],
    ["?", "?", "this sheet", actions.help],
  ];
}

/** The action of a key, if there is one. */
function actionOf(table, event) {
  if (event.altKey) return null;
  const control = event.ctrlKey || event.metaKey ? "ctrl+" : "";
  const letter = event.key.length === 1 && event.key.toLowerCase() !== event.key.toUpperCase();
  const shift = event.shiftKey && letter ? "shift+" : "";
  const key =
    /^[1-8]$/.test(event.key) && !control
      ? "digit"
      : `${control}${shift}${event.key.length === 1 ? event.key.toLowerCase() : event.key}`;
  return table.find(([name, , , action]) => action && name === key)?.[3] ?? null;
}

/** A key was pressed somewhere in a viewer. */
export function keyDown(viewer, event) {
  const { actions, stage } = viewer;
  const { target } = event;
  stage.element.classList.remove("by-hand");
  if (viewer.help.open || target.matches?.("input[type=text], select, textarea")) return;
  if (target.matches?.("input") && OF_INPUTS.test(event.key)) return;
  if (target.matches?.(".divider") && /^Arrow(Left|Right)$/.test(event.key)) {
    actions.moveWipe(event.key === "ArrowLeft" ? -0.02 : 0.02);
    event.preventDefault();
    return;
  }
  if (event.key === " ") {
    if (target.matches?.("button:not(.handle), input, summary")) return;
    if (!viewer.held) viewer.hold(true);
    event.preventDefault();
    return;
  }
  const action = actionOf(viewer.keys, event);
  // Selected text is copied as ever. That of a field stays selected when the focus leaves it, but is collapsed.
  if (!action || (action === actions.copyPicture && !getSelection().isCollapsed)) return;
  event.preventDefault();
  if (action !== actions.orbit) viewer.stop();
  action(event);
}

export function keyUp(viewer, event) {
  if (event.key === " " && viewer.held) viewer.hold(false);
  viewer.endGesture();
}

const rows = (entries) =>
  h("dl", {}, ...entries.map(([what, does]) => h("div", {}, h("dt", {}, what), h("dd", {}, does))));

/** A dialogue with gestures and keys: first those of fingers where there is no mouse. */
export function helpSheet(viewer, table) {
  const touch = matchMedia("(pointer: coarse)").matches;
  const keys = h("dl", { class: "keys" });
  for (const [key, text, does] of table) {
    if (text === undefined) keys.append(h("h4", {}, key));
    else if (text) keys.append(h("div", {}, h("dt", {}, text), h("dd", {}, does)));
  }
  const fingers = h("section", {}, h("h3", {}, "Fingers"), rows(FINGERS));
  const mouse = h("section", {}, h("h3", {}, "Mouse"), rows(MOUSE));
  const keyboard = [h("h3", {}, "Keyboard"), keys];
  const sheet = h(
    "dialog",
    { class: "help", "aria-label": "Help" },
    h(
      "form",
      { method: "dialog" },
      h("h2", {}, touch ? "Gestures and keys" : "Mouse and keys"),
      h("button", { class: "quiet" }, "Close"),
    ),
    ...(touch
      ? [fingers, h("details", {}, h("summary", {}, "Mouse and keyboard"), mouse, ...keyboard)]
      : [mouse, ...keyboard, fingers]),
  );
  sheet.addEventListener("click", (event) => event.target === sheet && sheet.close());
  // The focus is back where it was; from the button to where Space shows the photograph.
  sheet.addEventListener("close", () => {
    if (viewer.controls.helpButton.matches(":focus")) viewer.stage.element.focus({ preventScroll: true });
  });
  return sheet;
}

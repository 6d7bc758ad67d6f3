// The picture under one's hands: drag and the light follows; wheel and pinch zoom; handles, the wipe.
//
// Directions lie on the stage as on a map of the sphere, seen from the camera (Lambert's azimuthal equal-area
// projection): the camera in the middle, beside the person on the inner ring, behind them beyond it. A near light
// lies where the camera sees it, or at the stage's edge; a drag moves it in parallel to the picture. The map stays
// where it is when the picture is zoomed.

import { paintBall } from "./ball.js";
import { chroma } from "./colour.js";
import { h } from "./dom.js";
import { LIGHTS } from "./engine.js";
import { angles, clamp, direction, isNear, power } from "./lights.js";
import { shining, placeOf, placed, unplaced } from "./state.js";
import { fitting, panned, wheeled, zoomed } from "./zoom.js";

const MARGIN = 24; // CSS pixels around the picture
const FARTHEST = Math.SQRT2; // of the map, where the light is right behind
const ZOOM = [1, 16]; // of the scale at which all of the picture is seen
const CLICK = 4; // CSS pixels of motion below which a press is a click, which moves no light
const RIM = 30; // CSS pixels from the stage's edge to a near light that is seen beyond it

/** A place on the map, in units of the inner ring, right and up, to a direction. */
export function unprojected(right, up) {
  const radius = Math.min(Math.hypot(right, up), FARTHEST);
  const turn = 2 * Math.asin(radius / FARTHEST);
  const share = radius ? Math.sin(turn) / Math.hypot(right, up) : 0;
  return [right * share, up * share, Math.cos(turn)];
}

/** A direction to its place on the map. */
export function projected([x, y, z]) {
  const across = Math.hypot(x, y);
  const radius = FARTHEST * Math.sqrt(Math.max(0, (1 - z) / 2));
  return across < 1e-9 ? [z < 0 ? FARTHEST : 0, 0] : [(x / across) * radius, (y / across) * radius];
}

export class Stage {
  constructor(viewer) {
    this.viewer = viewer;
    this.canvas = h("canvas", { class: "picture" });
    this.canvases = [this.canvas];
    this.rings = h("div", { class: "rings", "aria-hidden": "true" }, h("i"), h("i"));
    this.handles = Array.from({ length: LIGHTS }, (_, index) => this.handle(index));
    this.divider = this.wipeDivider();
    this.labels = [0, 1].map(() => h("span", { class: "tag" }));
    this.readout = h("output", { class: "readout" });
    this.tools = this.viewTools();
    this.message = h("div", { class: "message", role: "status", "aria-live": "polite" });
    this.element = h(
      "div",
      {
        class: "stage",
        tabindex: 0,
        role: "application",
        "aria-label": "The person in new light. Arrow keys move the selected light; press question mark for all keys.",
        "data-drop": "background",
      },
      this.canvas,
      this.rings,
      this.divider,
      ...this.labels,
      ...this.handles,
      this.readout,
      this.tools,
      this.message,
    );
    this.pointers = new Map();
    const on = (name, listener, options) => this.element.addEventListener(name, listener, options);
    on("pointerdown", (event) => this.down(event));
    on("pointermove", (event) => this.move(event));
    for (const name of ["pointerup", "pointercancel"]) on(name, (event) => this.up(event));
    on("contextmenu", (event) => event.preventDefault());
    on("wheel", (event) => this.wheel(event), { passive: false });
    new ResizeObserver(() => this.layout()).observe(this.element);
  }

  /** Puts a new canvas in place of the one that has a context of another kind, and returns it. */
  replaceCanvas() {
    const canvas = h("canvas", { class: "picture" });
    this.canvas.replaceWith(canvas);
    this.canvas = canvas;
    this.canvases = [canvas];
    return canvas;
  }

  /** A canvas over the picture's, in its place and of its size on the page; hidden at first. */
  overlay() {
    const canvas = h("canvas", { class: "picture", hidden: true, "aria-hidden": "true" });
    this.canvas.after(canvas);
    this.canvases.push(canvas);
    this.see(this.view);
    return canvas;
  }

  handle(index) {
    const ball = h("canvas", { width: 52, height: 52 });
    const handle = h("button", { type: "button", class: "handle", hidden: true }, ball);
    handle.ball = ball;
    handle.addEventListener("focus", () => this.viewer.select(index));
    return handle;
  }

  wipeDivider() {
    return h(
      "div",
      {
        class: "divider",
        role: "slider",
        tabindex: 0,
        "aria-label": "Wipe",
        "aria-valuemin": 0,
        "aria-valuemax": 100,
        hidden: true,
      },
      h("i"),
    );
  }

  /** What looks at the picture: the photograph while it is held, and the zoom. */
  viewTools() {
    const { viewer } = this;
    const before = h(
      "button",
      { type: "button", class: "before", title: "Hold to see the photograph (Space)" },
      "Before",
    );
    const hold = (held) => (event) => {
      if (event.key === undefined || event.key === " " || event.key === "Enter") viewer.hold(held);
    };
    for (const name of ["pointerdown", "keydown"]) before.addEventListener(name, hold(true));
    for (const name of ["pointerup", "pointercancel", "pointerleave", "keyup", "blur"])
      before.addEventListener(name, hold(false));
    const button = (label, text, onclick) =>
      h("button", { type: "button", "aria-label": label, title: label, onclick }, text);
    this.fitButton = button("Show all of the picture (0)", "Show all", () => this.fit());
    return h(
      "div",
      { class: "view-tools" },
      before,
      button("Zoom out (Shift Z)", "−", () => this.zoom(0.7)),
      this.fitButton,
      button("Zoom in (Z)", "+", () => this.zoom(1.4)),
    );
  }

  /** Puts a brush on the stage: its button beside the zoom, and its tools above it. */
  hold(brush) {
    brush.toggle.classList.add("paint");
    this.tools.prepend(brush.toggle);
    this.element.append(brush.tools);
    brush.attach(this.viewer);
  }

  /** Fits the picture into the stage unless it is zoomed, and the map of directions about the person. */
  layout() {
    const { clientWidth: width, clientHeight: height } = this.element;
    const { size, box } = this.viewer.pack.description;
    const fit = fitting([width, height], size, Math.min(MARGIN, width / 16));
    if (!(fit.scale > 0)) return;
    const { view, sides } = this;
    this.sides = [width, height];
    this.fitted = fit;
    this.laidOut = placeOf(this.viewer.state);
    const middle = placed(this.laidOut, [(box[0] + box[2] / 2) / size[0], (box[1] + box[3] / 2) / size[1]]);
    this.middle = [fit.left + middle[0] * size[0] * fit.scale, fit.top + middle[1] * size[1] * fit.scale];
    this.radius = (0.46 * Math.min(width, height)) / FARTHEST;
    [1, FARTHEST].forEach((ring, index) => {
      const side = 2 * ring * this.radius;
      Object.assign(this.rings.children[index].style, {
        left: `${this.middle[0] - side / 2}px`,
        top: `${this.middle[1] - side / 2}px`,
        width: `${side}px`,
        height: `${side}px`,
      });
    });
    const zoomed = view && view.scale > view.fitted;
    this.see(
      zoomed
        ? {
            ...view,
            left: view.left + (width - sides[0]) / 2,
            top: view.top + (height - sides[1]) / 2,
            fitted: fit.scale,
          }
        : fit,
    );
  }

  /** Shows the picture in a view: all of it, or larger, with some of it in the stage's middle. */
  see(view) {
    const { size } = this.viewer.pack.description;
    const isZoomed = view.scale > view.fitted * 1.001;
    const [width, height] = size.map((side) => side * view.scale);
    const kept = (at, extent, side) => clamp(at, side / 2 - extent, side / 2);
    this.view = isZoomed
      ? { ...view, left: kept(view.left, width, this.sides[0]), top: kept(view.top, height, this.sides[1]) }
      : this.fitted;
    const { left, top } = this.view;
    this.scale = view.scale; // CSS pixels a pixel of the picture
    this.frame = { left, top, width, height };
    const place = { left: `${left}px`, top: `${top}px`, width: `${width}px`, height: `${height}px` };
    for (const canvas of this.canvases) Object.assign(canvas.style, place);
    this.tools.classList.toggle("zoomed", isZoomed);
    this.fitButton.disabled = !isZoomed;
    this.update(this.viewer.state);
  }

  zoom(times, about = this.sides.map((side) => side / 2)) {
    this.see(zoomed(this.view, times, about, about, ZOOM));
  }

  fit() {
    this.see(this.fitted);
  }

  // --- hands

  place(event) {
    const bounds = this.element.getBoundingClientRect();
    return [event.clientX - bounds.left, event.clientY - bounds.top];
  }

  down(event) {
    if (event.target.closest(".message button, .view-tools, .painting-tools, .notice")) return;
    const { viewer } = this;
    viewer.stop();
    this.element.classList.add("by-hand"); // the focus is where the hand is: no need to mark it
    this.element.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, { start: this.place(event), now: this.place(event) });
    if (event.target.closest(".divider")) this.task = "wipe";
    else if (event.button === 2 && event.shiftKey) this.task = "turn";
    else if (event.button > 0 || this.pointers.size === 2) this.task = "pan";
    else if (this.pointers.size === 1) {
      const grabbed = this.handles.findIndex((handle) => handle.contains(event.target));
      if (grabbed >= 0) viewer.select(grabbed);
      this.task = "press"; // a click; it aims once the hand moves
    } else return;
    if (event.target.focus && !this.canvases.includes(event.target)) event.target.focus({ preventScroll: true });
    else this.element.focus({ preventScroll: true });
    event.preventDefault();
    if (this.task === "turn" || this.task === "pan") this.beginTurn();
    else this.move(event);
  }

  /** Two fingers, or another button: what they move, spread and turn is measured from here. */
  beginTurn() {
    const { state } = this.viewer;
    if (this.before) this.viewer.change((now) => (now.lights[now.selected] = structuredClone(this.before)), "aim");
    this.before = null;
    for (const pointer of this.pointers.values()) pointer.start = pointer.now;
    this.began = { rotation: state.environment?.rotation, view: this.view };
    if (this.task === "turn" && !state.environment)
      this.viewer.say("There is no environment to turn: drop a map on the panel.");
  }

  move(event) {
    const pointer = this.pointers.get(event.pointerId);
    if (!pointer) return;
    pointer.now = this.place(event);
    const { start, now } = pointer;
    if (this.task === "press" && Math.hypot(now[0] - start[0], now[1] - start[1]) >= CLICK) this.beginAim();
    if (this.task === "aim") this.aim(pointer.now);
    else if (this.task === "turn") this.turn(now[0] - start[0]);
    else if (this.task === "pan") {
      const pointers = [...this.pointers.values()];
      this.see(
        panned(
          this.began.view,
          pointers.map((one) => one.start),
          pointers.map((one) => one.now),
          ZOOM,
        ),
      );
    } else if (this.task === "wipe")
      this.viewer.change(
        (state) => (state.wipe.at = clamp((pointer.now[0] - this.frame.left) / this.frame.width, 0, 1)),
        "wipe",
      );
  }

  beginAim() {
    const { viewer } = this;
    if (!viewer.state.lights.length) viewer.actions.add();
    this.task = "aim";
    this.before = structuredClone(viewer.state.lights[viewer.state.selected]);
  }

  aim([x, y]) {
    const { room, state } = this.viewer;
    const { position } = state.lights[state.selected];
    if (position) {
      const { left, top, width, height } = this.frame;
      const at = unplaced(placeOf(state), [(x - left) / width, (y - top) / height]);
      const moved = room.seenAt([(at[0] * width) / this.scale, (at[1] * height) / this.scale], position[2]);
      this.viewer.change((now) => (now.lights[now.selected].position = moved), "aim");
      this.element.classList.add("placing");
      return;
    }
    const toward = unprojected((x - this.middle[0]) / this.radius, (this.middle[1] - y) / this.radius);
    this.viewer.change((state) => Object.assign(state.lights[state.selected], angles(toward)), "aim");
    this.element.classList.add("aiming");
  }

  /** Turns the environment by a motion to the right, in CSS pixels. */
  turn(moved) {
    this.viewer.change(
      (state) => state.environment && (state.environment.rotation = this.began.rotation + (moved / this.radius) * 45),
      "turn",
    );
  }

  up(event) {
    if (!this.pointers.delete(event.pointerId)) return;
    if (this.pointers.size) {
      this.task = this.before = null; // what two fingers did ends with the first that leaves
      return;
    }
    this.task = this.before = null;
    this.element.classList.remove("aiming", "placing");
    this.viewer.endGesture();
  }

  wheel(event) {
    event.preventDefault();
    this.zoom(wheeled(event), this.place(event));
  }

  /** Where a light's handle is, CSS pixels on the stage. */
  placeOf(light) {
    if (!isNear(light)) {
      const [right, up] = projected(direction(light));
      return [this.middle[0] + right * this.radius, this.middle[1] - up * this.radius];
    }
    const { width, height } = this.frame;
    const [right, down] = this.viewer.room.onPicture(light.position).map((value) => value * this.scale);
    const share = placed(placeOf(this.viewer.state), [right / width, down / height]);
    const [x, y] = [share[0] * width, share[1] * height];
    const { clientWidth, clientHeight } = this.element;
    return [clamp(this.frame.left + x, RIM, clientWidth - RIM), clamp(this.frame.top + y, RIM, clientHeight - RIM)];
  }

  /** Shows for a moment what the selected light is set to. */
  tell() {
    this.element.classList.add("telling");
    clearTimeout(this.telling);
    this.telling = setTimeout(() => this.element.classList.remove("telling"), 900);
  }

  // --- showing

  update(state) {
    if (!this.frame) return;
    if (JSON.stringify(placeOf(state)) !== JSON.stringify(this.laidOut)) {
      this.layout(); // which comes back here
      return;
    }
    const active = new Set(shining(state));
    this.handles.forEach((handle, index) => {
      const light = state.lights[index];
      handle.hidden = !light || this.viewer.bare;
      if (handle.hidden) return;
      const [left, top] = this.placeOf(light);
      handle.style.transform = `translate(${left}px, ${top}px)`;
      handle.classList.toggle("near", isNear(light));
      handle.classList.toggle("selected", index === state.selected);
      handle.classList.toggle("off", !active.has(light));
      const name = light.name || `light${index + 1}`;
      handle.setAttribute("aria-label", `${name}: ${described(light)}`);
      handle.title = name;
      paintBall(handle.ball, [{ light, colour: chroma(power(light, this.viewer.tints)) }], 0.06);
    });
    const selected = state.lights[state.selected];
    this.readout.textContent = selected ? described(selected) : "";
    const { wipe } = state;
    this.divider.hidden = !wipe;
    this.labels.forEach((label) => (label.hidden = !wipe));
    if (wipe) {
      const { left, top, width, height } = this.frame;
      Object.assign(this.divider.style, {
        left: `${left + wipe.at * width}px`,
        top: `${top}px`,
        height: `${height}px`,
      });
      this.divider.setAttribute("aria-valuenow", Math.round(wipe.at * 100));
      [state.look, wipe.look].forEach((look, index) => {
        this.labels[index].textContent = look;
        Object.assign(this.labels[index].style, { left: `${left + (index ? width : 0)}px`, top: `${top}px` });
      });
    }
  }
}

function described(light) {
  if (isNear(light)) {
    const metres = (value) =>
      value
        .toFixed(2)
        .replace("-", "−")
        .replace(/^−0.00$/, "0.00");
    const [x, y, z] = light.position.map(metres);
    const size = light.radius ? `, radius ${metres(light.radius)}` : "";
    return `${x} right, ${y} up, ${z} to the camera${size} m`;
  }
  const { azimuth, elevation, angle } = light;
  const degrees = (value) => `${value.toFixed(0).replace("-", "−").replace(/^−0$/, "0")}°`;
  const behind = direction({ azimuth, elevation })[2] < -0.02 ? ", behind" : "";
  const soft = angle ? `, softness ${degrees(angle)}` : "";
  return `azimuth ${degrees(azimuth)}, elevation ${degrees(elevation)}${soft}${behind}`;
}

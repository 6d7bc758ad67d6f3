// A brush of light on the picture: brighter or darker, while one paints the lights follow.

import { h } from "./dom.js";
import { PersonPoints, paintedLights } from "./painting.js";
import { checkedLight, placeOf, placed, unplaced } from "./state.js";

const BRUSHED = "brush"; // what is painted in one go is undone in one step
const BRUSH_RADIUS = { min: 1, max: 20, value: 6 }; // per cent of the picture's height
const MISSED = 0.3; // stops by which a stroke may be missed without a word

/** What is under one's hands; a subclass finds the lights. */
export class Brush {
  constructor() {
    this.strokes = [];
    this.sign = 1;
    this.canvas = h("canvas", { class: "strokes", hidden: true, "aria-hidden": "true" });
    const on = (name, listener) => this.canvas.addEventListener(name, listener);
    on("pointerdown", (event) => this.down(event));
    on("pointermove", (event) => this.move(event));
    for (const name of ["pointerup", "pointercancel"]) on(name, (event) => this.up(event));
    const button = (label, onclick, attributes = {}) => h("button", { type: "button", onclick, ...attributes }, label);
    this.toggle = button("Paint the light", () => this.set(this.canvas.hidden), { "aria-pressed": "false" });
    this.signs = [1, -1].map((sign) =>
      button(sign > 0 ? "+" : "−", () => this.choose(sign), {
        "aria-label": sign > 0 ? "Brighter" : "Darker",
        "aria-pressed": String(sign > 0),
      }),
    );
    this.size = h("input", { type: "range", "aria-label": "Size of the brush", ...BRUSH_RADIUS });
    this.undone = button("Undo stroke", () => this.undo());
    this.done = button("Done", () => this.set(false));
    this.said = h("output", {});
    this.tools = h(
      "span",
      { class: "painting-tools", hidden: true },
      ...this.signs,
      this.size,
      this.undone,
      this.done,
      this.said,
    );
    this.element = h("div", { class: "painting", role: "group", "aria-label": "Brush" }, this.toggle, this.tools);
  }

  /** Lies on another viewer's picture. */
  attach(viewer) {
    this.set(false);
    this.viewer = viewer;
    viewer.stage.element.append(this.canvas);
    viewer.listeners.add(() => this.draw());
  }

  /** Begins or ends painting. */
  set(isOn) {
    this.canvas.hidden = this.tools.hidden = !isOn;
    this.toggle.setAttribute("aria-pressed", String(isOn));
    this.strokes = [];
    this.said.textContent = "";
    this.quit();
    if (!this.viewer) return;
    this.viewer.stop();
    this.viewer.endGesture();
    this.began = structuredClone(this.viewer.state);
    this.begin();
    this.draw();
  }

  /** The light with which painting begins is `began`. */
  begin() {}

  /** Has the lights of the strokes made; `take` gets them. */
  want() {}

  /** Ends what is on its way. */
  quit() {}

  choose(sign) {
    this.sign = sign;
    this.signs.forEach((button, index) => button.setAttribute("aria-pressed", String((index ? -1 : 1) === sign)));
  }

  /** The place of a pointer, in shares of the picture. */
  place(event) {
    const bounds = this.canvas.getBoundingClientRect();
    const { scale, left, top } = this.viewer.stage.view;
    const [width, height] = this.viewer.engine.size;
    return unplaced(placeOf(this.viewer.state), [
      (event.clientX - bounds.left - left) / (scale * width),
      (event.clientY - bounds.top - top) / (scale * height),
    ]);
  }

  down(event) {
    if (event.button) return;
    event.stopPropagation();
    this.canvas.setPointerCapture(event.pointerId);
    this.stroke = {
      points: [this.place(event)],
      radius: this.size.valueAsNumber / 100 / placeOf(this.viewer.state).scale,
      brighter: this.sign > 0,
    };
    this.strokes.push(this.stroke);
    this.changed();
  }

  move(event) {
    event.stopPropagation();
    if (!this.stroke) return;
    this.stroke.points.push(this.place(event));
    this.changed();
  }

  up(event) {
    event.stopPropagation();
    this.stroke = null;
  }

  undo() {
    this.strokes.pop();
    this.changed();
  }

  changed() {
    this.draw();
    if (this.strokes.length) {
      this.want();
      return;
    }
    this.quit();
    this.said.textContent = "";
    const { lights, environment, selected } = this.began;
    this.viewer.change((state) => Object.assign(state, structuredClone({ lights, environment, selected })), BRUSHED);
  }

  /** Moves the handles to lights, and says how near they come. */
  take({ lights, environment, strokes }) {
    this.viewer.change((state) => {
      state.lights = lights.map((light) => checkedLight(light));
      state.selected = Math.min(state.selected, Math.max(0, lights.length - 1));
      if (state.environment) state.environment.intensity = environment;
    }, BRUSHED);
    this.say(strokes.map(sentence).filter(Boolean).join(" "));
  }

  say(text) {
    this.said.textContent = text;
  }

  /** Draws the strokes over the picture. */
  draw() {
    if (this.canvas.hidden || !this.viewer) return;
    const { width, height } = this.canvas.getBoundingClientRect();
    Object.assign(this.canvas, { width: Math.round(width), height: Math.round(height) });
    const context = this.canvas.getContext("2d");
    const { scale, left, top } = this.viewer.stage.view;
    const place = placeOf(this.viewer.state);
    const size = this.viewer.engine.size.map((side) => side * scale);
    context.lineCap = context.lineJoin = "round";
    for (const { points, radius, brighter } of this.strokes) {
      context.strokeStyle = brighter ? "rgb(255 90 60 / 25%)" : "rgb(60 120 255 / 30%)";
      context.lineWidth = 2 * radius * size[1] * place.scale;
      context.beginPath();
      for (const [x, y] of [...points, points.at(-1)].map((point) => placed(place, point)))
        context.lineTo(left + x * size[0], top + y * size[1]);
      context.stroke();
    }
  }
}

/** Says how near a stroke came, where it was missed. */
function sentence({ asked, reached }) {
  if (Math.abs(Math.log2(Math.max(reached, 1e-3) / asked)) < MISSED) return "";
  const kind = asked > 1 ? "Brighter" : "Darker";
  return `${kind}: ${asked.toFixed(2)} times the light was asked for, ${reached.toFixed(2)} is the nearest.`;
}

/** The brush of a page: the page itself finds the lights, at the browser's next frame. */
export class PageBrush extends Brush {
  constructor() {
    super();
    this.points = this.base = this.asked = null;
  }

  begin() {
    this.points ??= new PersonPoints(this.viewer);
    this.base = null;
  }

  want() {
    this.asked ??= requestAnimationFrame(() => {
      this.asked = null;
      this.base ??= this.points.lit(this.viewer, this.began);
      const answer = paintedLights(this.points, this.base, this.strokes);
      if (answer) this.take(answer);
      else this.say("The strokes are beside the person, or cancel each other.");
    });
  }

  quit() {
    cancelAnimationFrame(this.asked);
    this.asked = null;
  }
}

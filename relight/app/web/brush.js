// A brush of light on the picture: brighter or darker. The server solves for the lights while one paints.

import { checkedLight, h, placeOf, placed, unplaced } from "../viewer.js";
import { Latest } from "./latest.js";
import { Refused, post } from "./requests.js";

const PAUSE = 40; // milliseconds after a stroke grows before its lights are asked for
const GESTURE = "brush"; // what is painted in one go is undone in one step
const RADIUS = { min: 1, max: 20, value: 6 }; // per cent of the picture's height
const NEAR = 0.3; // stops by which a stroke may be missed without a word

export class Brush {
  /** `app`: says what went wrong; `look(viewer)`: the light as the server takes it. */
  constructor(app, look) {
    this.app = app;
    this.look = look;
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
    this.size = h("input", { type: "range", "aria-label": "Size of the brush", ...RADIUS });
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
    this.latest = new Latest(
      PAUSE,
      (text) => this.solve(text),
      (error) => this.failed(error),
    );
  }

  /** Lies on another viewer's picture. */
  attach(viewer, photograph) {
    this.set(false);
    this.viewer = viewer;
    this.photograph = photograph;
    viewer.stage.element.append(this.canvas);
    viewer.listeners.add(() => this.draw());
  }

  /** Begins or ends painting. */
  set(isOn) {
    this.canvas.hidden = this.tools.hidden = !isOn;
    this.toggle.setAttribute("aria-pressed", String(isOn));
    this.strokes = [];
    this.said.textContent = "";
    this.latest.close();
    if (!this.viewer) return;
    this.viewer.stop();
    this.viewer.endGesture();
    this.began = structuredClone(this.viewer.state);
    this.base = this.look(this.viewer);
    this.draw();
  }

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
      this.latest.want(JSON.stringify({ look: this.base, strokes: this.strokes }));
      return;
    }
    this.latest.close();
    this.said.textContent = "";
    const { lights, environment, selected } = this.began;
    this.viewer.change((state) => Object.assign(state, structuredClone({ lights, environment, selected })), GESTURE);
  }

  /** Has the lights made, and moves the handles to them. */
  async solve(text) {
    const response = await post(`photographs/${this.photograph.id}/paint`, JSON.parse(text));
    const { lights, environment, strokes } = await response.json();
    if (!this.latest.wanted) return;
    this.viewer.change((state) => {
      state.lights = lights.map((light) => checkedLight(light));
      state.selected = Math.min(state.selected, Math.max(0, lights.length - 1));
      if (state.environment) state.environment.intensity = environment;
    }, GESTURE);
    this.said.textContent = strokes.map(sentence).filter(Boolean).join(" ");
  }

  failed(error) {
    if (error instanceof Refused) this.said.textContent = error.message;
    else this.app.fail(error);
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
  if (Math.abs(Math.log2(Math.max(reached, 1e-3) / asked)) < NEAR) return "";
  const kind = asked > 1 ? "Brighter" : "Darker";
  return `${kind}: ${asked.toFixed(2)} times the light was asked for, ${reached.toFixed(2)} is the nearest.`;
}

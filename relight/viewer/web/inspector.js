// The selected light: where it stands, how bright and how soft it is, its colour.

import { paintBall } from "./ball.js";
import { chroma, fromHex, toHex } from "./colour.js";
import { choice, h, more } from "./dom.js";
import { LOCI, angles, irradiance, isNear, power } from "./lights.js";
import { Plan } from "./plan.js";
import { STOPS, bound } from "./sliders.js";
import { unprojected } from "./stage.js";
import { shining } from "./state.js";

const mired = (value) => 1e6 / value;
const selected = (state) => state.lights[state.selected];
const distant = (state) => selected(state) && !isNear(selected(state)) && selected(state);
const near = (state) => selected(state) && isNear(selected(state)) && selected(state);

export class Inspector {
  /** `id`: sets the radio buttons of two panels in one document apart. */
  constructor(viewer, id) {
    this.viewer = viewer;
    const slide = (...words) => bound(viewer, ...words);
    const reach = Math.max(1.5 * viewer.room.height, 0.5);
    const metres = { step: 0.01, unit: "m", low: -1e6, high: 1e6 };
    this.ball = h("canvas", {
      class: "ball",
      width: 192,
      height: 192,
      "aria-hidden": "true",
      title: "Drag: the light follows",
    });
    this.listenToBall();
    this.plan = new Plan(viewer);
    this.distance = choice(
      `distance${id}`,
      "Distance",
      [
        ["far", "Far"],
        ["near", "Near"],
      ],
      // The state may be ahead of what is drawn: a light that is there already stays.
      (kind) => isNear(selected(viewer.state)) === (kind === "near") || viewer.actions.switch(),
    );
    this.aims = [
      slide("Azimuth", "azimuth", distant, { min: -180, max: 180, step: 0.5, unit: "°", digits: 1 }),
      slide("Elevation", "elevation", distant, { min: -90, max: 90, step: 0.5, unit: "°", digits: 1 }),
    ];
    this.angles = more("angles of the light", ...this.aims);
    this.places = ["Right", "Up", "To camera"].map((label, axis) =>
      slide(label, axis, (state) => near(state)?.position, { ...metres, min: -reach, max: reach }),
    );
    this.exposure = slide("Exposure", "exposure", selected, STOPS);
    this.arriving = h("output");
    this.meter = h(
      "div",
      {
        class: "slider meter",
        title:
          "Irradiance at the person's middle, on a surface that faces the lamp. A distant light of exposure 0 gives 1.",
      },
      h("span", { class: "label" }, "At the person"),
      this.arriving,
    );
    this.softness = slide("Softness", "angle", distant, {
      min: 0,
      max: 120,
      step: 0.5,
      unit: "°",
      digits: 1,
    });
    this.radius = slide("Radius", "radius", near, { ...metres, min: 0, max: reach / 5, low: 0 });
    this.kelvin = slide("Kelvin", "temperature", selected, {
      min: mired(12000),
      max: mired(1800),
      step: 0.5,
      unit: "K",
      digits: 0,
      neutral: 6500,
      off: "off",
      low: LOCI.planckian[0],
      high: LOCI.planckian[1],
      limits: (light) => light && LOCI[light.locus],
      place: mired,
      value: mired,
    });
    this.kelvin.classList.add("kelvin");
    this.element = h(
      "section",
      { class: "inspector", "aria-label": "The selected light" },
      h("div", { class: "aim" }, this.ball, h("div", { class: "aims" }, this.distance)),
      this.plan.element,
      ...this.places,
      this.exposure,
      this.meter,
      this.softness,
      this.radius,
      this.kelvin,
      this.colour(),
      this.angles,
    );
  }

  colour() {
    const { viewer } = this;
    this.swatch = h("input", { type: "color", "aria-label": "Colour of the light" });
    this.swatch.addEventListener("input", () =>
      viewer.change((state) => {
        const brightest = Math.max(...selected(state).colour) || 1;
        selected(state).colour = chroma(fromHex(this.swatch.value)).map((value) => value * brightest);
      }, "swatch"),
    );
    this.swatch.addEventListener("change", () => viewer.endGesture());
    const white = () =>
      viewer.change((state) => Object.assign(selected(state), { temperature: null, colour: [1, 1, 1] }));
    return h(
      "div",
      { class: "row" },
      h("span", { class: "label" }, "Colour"),
      this.swatch,
      h("button", { type: "button", class: "quiet", onclick: white }, "White"),
    );
  }

  /** The sphere is a handle of a distant light. */
  listenToBall() {
    const { ball, viewer } = this;
    const aim = (event) => {
      if (!ball.hasPointerCapture(event.pointerId)) return;
      const bounds = ball.getBoundingClientRect();
      const right = ((event.clientX - bounds.left) / bounds.width) * 2 - 1;
      const up = 1 - ((event.clientY - bounds.top) / bounds.height) * 2;
      const toward = unprojected(right, up);
      viewer.change((state) => Object.assign(selected(state), angles(toward)), "ball");
    };
    ball.addEventListener("pointerdown", (event) => {
      viewer.stop();
      ball.setPointerCapture(event.pointerId);
      aim(event);
    });
    ball.addEventListener("pointermove", aim);
    ball.addEventListener("pointerup", () => viewer.endGesture());
  }

  /** Shows a state. */
  update(state) {
    const { viewer } = this;
    const light = selected(state);
    this.element.hidden = !light;
    if (!light) return;
    const lamp = isNear(light);
    this.distance.set(lamp ? "near" : "far");
    for (const control of [this.angles, this.softness]) control.hidden = lamp;
    for (const control of [...this.places, this.radius, this.meter]) control.hidden = !lamp;
    for (const control of [...this.aims, ...this.places, this.exposure, this.softness, this.radius, this.kelvin])
      control.refresh(state);
    this.plan.element.hidden = !lamp;
    this.ball.hidden = lamp; // the plan holds it instead
    if (lamp) {
      this.arriving.textContent = metered(irradiance(light, viewer.tints));
      this.plan.update(state);
    }
    this.swatch.value = toHex(chroma(light.colour));
    if (!lamp)
      paintBall(
        this.ball,
        shining(state).map((one) => ({ light: one, colour: power(one, viewer.tints) })),
      );
  }
}

/** Irradiance as a number, and in stops from 1. */
function metered(value) {
  if (!(value > 0)) return "0";
  const stops = Math.log2(value);
  const sign = stops < -0.005 ? "−" : "+";
  return `${Number(value.toPrecision(3))} · ${sign}${Math.abs(stops).toFixed(2)} stops`;
}

// How sure the analysis is of its shadows, as colours over the picture; the server sends the probabilities.

import { h, lightTexts, placeOf } from "../viewer.js";
import { Latest } from "./latest.js";
import { post } from "./requests.js";

const PAUSE = 120; // milliseconds after a change of the light before its probabilities are asked for
const ALL = "all"; // directions, in place of one light
const COLOURS = [
  [255, 220, 40, 0],
  [255, 200, 30, 0.5],
  [235, 80, 30, 0.7],
  [130, 20, 150, 0.85],
]; // red, green, blue and opacity, evenly from sure (1) to a guess (0.5) on the scale of `place`
const TICKS = [1, 0.95, 0.85, 0.7, 0.5];

/** Where a probability lies on the scale from sure, 0, to a guess, 1: small doubts take much of it. */
const place = (sure) => Math.sqrt(Math.max(0, 2 * (1 - sure)));

const css = ([red, green, blue, opacity]) => `rgb(${red} ${green} ${blue} / ${100 * opacity}%)`;

export class Confidence {
  /** `fail(error)`: says what went wrong. */
  constructor(fail) {
    this.fail = fail;
    this.toggle = h(
      "button",
      { type: "button", "aria-pressed": "false", onclick: () => this.set(this.tools.hidden) },
      "Confidence",
    );
    this.choice = h("select", { "aria-label": "Shadows of", onchange: () => this.follow() });
    const colours = `linear-gradient(to right, ${COLOURS.map(css).join(", ")})`;
    const ticks = TICKS.map((sure) => h("span", { style: `left: ${100 * place(sure)}%` }, `${100 * sure} %`));
    const scale = h("span", { class: "scale", "aria-hidden": "true" }, h("i", { style: `background: ${colours}` }));
    scale.append(...ticks);
    this.tools = h("span", { class: "confidence-tools", hidden: true }, this.choice, scale);
    this.element = h("div", { class: "confidence", role: "group", "aria-label": "Confidence" });
    this.element.append(this.toggle, this.tools);
    this.latest = new Latest(PAUSE, (text) => this.show(JSON.parse(text)), fail);
  }

  /** Lies on another viewer's picture. */
  attach(viewer, photograph) {
    this.set(false);
    this.viewer = viewer;
    this.photograph = photograph;
    this.canvas = viewer.stage.overlay();
    this.canvas.classList.add("doubts");
    viewer.listeners.add(() => this.follow());
  }

  set(isOn) {
    this.tools.hidden = !isOn;
    this.toggle.setAttribute("aria-pressed", String(isOn));
    if (this.canvas) this.canvas.hidden = true; // until the probabilities have come
    this.follow();
  }

  /** Lists the lights that shine, and asks for the probabilities of what is chosen. */
  follow() {
    if (this.tools.hidden || !this.viewer) {
      this.latest.close();
      return;
    }
    const { scale, right, up } = placeOf(this.viewer.state);
    this.canvas.style.transform = `translate(${100 * right}%, ${-100 * up}%) scale(${scale})`;
    const lights = new Map(lightTexts(this.viewer.state).map((text) => [text.split(":")[0], text]));
    const names = [ALL, ...lights.keys()];
    if (names.join() !== [...this.choice.options].map((option) => option.value).join()) {
      const { value } = this.choice;
      const label = (name) => (name === ALL ? "All directions" : name);
      this.choice.replaceChildren(...names.map((name) => h("option", { value: name }, label(name))));
      this.choice.value = names.includes(value) ? value : ALL;
    }
    this.latest.want(JSON.stringify({ light: lights.get(this.choice.value) ?? null }));
  }

  async show(asked) {
    const { canvas, viewer } = this;
    const response = await post(`photographs/${this.photograph.id}/confidence`, asked);
    const picture = await createImageBitmap(await response.blob());
    if (!this.latest.wanted || viewer !== this.viewer) return;
    [canvas.width, canvas.height] = [picture.width, picture.height];
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.drawImage(picture, 0, 0);
    const pixels = context.getImageData(0, 0, picture.width, picture.height);
    paint(pixels.data);
    context.putImageData(pixels, 0, 0);
    canvas.hidden = false;
  }
}

/** Turns the codes of a probability into colours; 0 is no person. */
function paint(data) {
  const table = Array.from({ length: 256 }, (_, code) => (code ? colourAt(place(code / 255)) : [0, 0, 0, 0]));
  for (let at = 0; at < data.length; at += 4) {
    const colour = table[data[at]];
    for (let channel = 0; channel < 4; channel++) data[at + channel] = colour[channel];
  }
}

function colourAt(at) {
  const last = COLOURS.length - 1;
  const low = Math.min(Math.floor(at * last), last - 1);
  const share = Math.min(at * last - low, 1);
  const colour = COLOURS[low].map((value, channel) => value + share * (COLOURS[low + 1][channel] - value));
  return [...colour.slice(0, 3), 255 * colour[3]];
}

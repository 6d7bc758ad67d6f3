// The panel beside the picture: lights, the selected one, environment, background, view, and what goes out.

import { chroma, paintBall, toHex } from "./ball.js";
import { choice, h, iconButton, slider } from "./dom.js";
import { LIGHTS, LOOKS } from "./engine.js";
import { decoded } from "./environment.js";
import { LOCI, clamp, isNear, power } from "./lights.js";
import { nameOf, shining } from "./state.js";

export const LOOK_NAMES = {
  picture: "Picture",
  light: "Light",
  visibility: "Visibility",
  normals: "Normals",
  albedo: "Albedo",
  photograph: "Photo",
};

let serial = 0; // radio buttons of two pages in one notebook are apart

export class Controls {
  constructor(viewer) {
    this.viewer = viewer;
    this.id = ++serial;
    const { actions } = viewer;
    this.undo = iconButton("undo", "Undo", actions.undo, "Ctrl Z");
    this.redo = iconButton("redo", "Redo", actions.redo, "Ctrl Shift Z");
    this.play = iconButton("play", "Play an orbit", actions.orbit, "T");
    this.element = h(
      "aside",
      { class: "panel", "aria-label": "Lights and view" },
      h("header", {}, h("h1", {}, viewer.scene.title), this.play, this.undo, this.redo, iconButton("help", "Help", actions.help, "?")),
      this.lightList(),
      this.inspector(),
      this.environment(),
      this.background(),
      this.view(),
      this.out(),
    );
  }

  change(mutate, gesture) {
    this.viewer.change(mutate, gesture);
  }

  /** A slider of what `owner` picks from the state. */
  bound(label, key, owner, options) {
    const control = slider({
      label,
      ...options,
      onchange: (given) => {
        const value = clamp(given, options.low ?? options.min, options.high ?? options.max);
        this.change((state) => owner(state) && (owner(state)[key] = value), `${label}${this.viewer.state.selected}`);
      },
      onend: () => this.viewer.endGesture(),
    });
    control.refresh = (state) => owner(state) && control.set(owner(state)[key] ?? options.neutral);
    return control;
  }

  lightList() {
    const { actions } = this.viewer;
    this.rows = Array.from({ length: LIGHTS }, (_, index) => this.lightRow(index));
    this.add = iconButton("add", "Add a light", actions.add, "A");
    this.empty = h("p", { class: "hint" }, "No light: the person stands in the dark.");
    return h(
      "section",
      { "aria-label": "Lights" },
      h("h2", {}, "Lights", this.add),
      h("ul", { class: "lights" }, ...this.rows.map(({ element }) => element)),
      this.empty,
    );
  }

  lightRow(index) {
    const { viewer } = this;
    const of = (state) => state.lights[index];
    const toggle = (key, letter, label) =>
      h("button", { type: "button", class: `toggle ${key}`, "aria-label": label, title: label, onclick: () => this.change((state) => (of(state)[key] = !of(state)[key])) }, letter);
    const row = {
      ball: h("canvas", { width: 36, height: 36, "aria-hidden": "true" }),
      name: h("input", { type: "text", class: "name", maxlength: 80, spellcheck: "false", "aria-label": `Name of light ${index + 1}` }),
      solo: toggle("solo", "S", "Solo"),
      muted: toggle("muted", "M", "Mute"),
      remove: iconButton("delete", "Delete this light", () => viewer.actions.remove(index)),
    };
    row.name.addEventListener("change", () => this.change((state) => (of(state).name = nameOf(row.name.value))));
    row.name.addEventListener("focus", () => viewer.select(index));
    row.element = h("li", {}, row.ball, row.name, row.solo, row.muted, row.remove);
    row.element.addEventListener("pointerdown", () => viewer.select(index));
    return row;
  }

  inspector() {
    const selected = (state) => state.lights[state.selected];
    const mired = (value) => 1e6 / value;
    this.ball = h("canvas", { class: "ball", width: 192, height: 192, "aria-hidden": "true", title: "Drag: the light follows" });
    this.viewer.holdBall(this.ball);
    this.swatch = h("input", { type: "color", "aria-label": "Colour of the light" });
    this.swatch.addEventListener("input", () =>
      this.change((state) => {
        const brightest = Math.max(...selected(state).colour) || 1;
        const codes = [1, 3, 5].map((at) => parseInt(this.swatch.value.slice(at, at + 2), 16) / 255);
        selected(state).colour = chroma(codes.map(decoded)).map((value) => value * brightest);
      }, "swatch"),
    );
    this.swatch.addEventListener("change", () => this.viewer.endGesture());
    this.white = h("button", { type: "button", class: "quiet", onclick: () => this.change((state) => Object.assign(selected(state), { temperature: null, colour: [1, 1, 1] })) }, "White");
    const distant = (state) => selected(state) && !isNear(selected(state)) && selected(state);
    const near = (state) => selected(state) && isNear(selected(state)) && selected(state);
    const reach = Math.max(1.5 * this.viewer.room.height, 0.5);
    const metres = { step: 0.01, unit: "m", low: -1e6, high: 1e6 };
    this.aims = [
      this.bound("Azimuth", "azimuth", distant, { min: -180, max: 180, step: 0.5, unit: "°", digits: 1 }),
      this.bound("Elevation", "elevation", distant, { min: -90, max: 90, step: 0.5, unit: "°", digits: 1 }),
    ];
    this.places = ["Right", "Up", "To camera"].map((label, axis) =>
      this.bound(label, axis, (state) => near(state)?.position, { ...metres, min: -reach, max: reach }),
    );
    this.distance = choice(`distance${this.id}`, "Distance", [["far", "Far"], ["near", "Near"]], () => this.viewer.actions.switch());
    this.softness = this.bound("Softness", "angle", distant, { min: 0, max: 120, step: 0.5, unit: "°", digits: 1, high: 180 });
    this.radius = this.bound("Radius", "radius", near, { ...metres, min: 0, max: reach / 5, low: 0 });
    this.sliders = [
      this.bound("Exposure", "exposure", selected, { min: -6, max: 6, step: 0.05, unit: "stops", low: -64, high: 64 }),
      this.softness,
      this.radius,
      this.bound("Kelvin", "temperature", selected, {
        min: mired(12000), max: mired(1800), step: 0.5, unit: "K", digits: 0, neutral: 6500,
        low: LOCI.planckian[0], high: LOCI.planckian[1], place: mired, value: mired,
      }),
    ];
    this.sliders.at(-1).classList.add("kelvin");
    this.inspected = h(
      "section",
      { class: "inspector", "aria-label": "The selected light" },
      h("div", { class: "aim" }, this.ball, h("div", { class: "aims" }, this.distance, ...this.aims)),
      ...this.places,
      ...this.sliders,
      h("div", { class: "row" }, h("span", { class: "label" }, "Colour"), this.swatch, this.white),
    );
    return this.inspected;
  }

  environment() {
    const of = (state) => state.environment;
    this.environmentName = h("span", { class: "file" });
    this.environmentSliders = [
      this.bound("Rotation", "rotation", of, { min: -180, max: 180, step: 1, unit: "°", digits: 1, low: -1e6, high: 1e6 }),
      this.bound("Strength", "exposure", of, { min: -6, max: 6, step: 0.05, unit: "stops", low: -64, high: 64 }),
    ];
    this.environmentMute = h("button", { type: "button", class: "toggle muted", "aria-label": "Mute the environment", title: "Mute", onclick: () => this.change((state) => (of(state).muted = !of(state).muted)) }, "M");
    this.environmentRemove = iconButton("delete", "Remove the environment", () => this.change((state) => (state.environment = null)));
    this.environmentBody = h("div", {}, h("div", { class: "row" }, this.environmentName, this.environmentMute, this.environmentRemove), ...this.environmentSliders);
    this.environmentHint = h("p", { class: "hint" }, "Drop a latitude-longitude map (.hdr or a picture) on this panel.");
    const open = this.fileButton("Open…", ".hdr,.rgbe,.pic,image/*", (file) => this.viewer.openEnvironment(file));
    this.environmentSection = h("section", { "aria-label": "Environment", "data-drop": "environment" }, h("h2", {}, "Environment", open), this.environmentHint, this.environmentBody);
    return this.environmentSection;
  }

  background() {
    this.backgroundKind = choice(`background${this.id}`, "Background", [["none", "None"], ["colour", "Colour"], ["picture", "Picture"]], (kind) => this.viewer.setBackgroundKind(kind));
    this.backgroundColour = h("input", { type: "color", "aria-label": "Background colour", value: "#1c1e22" });
    this.backgroundColour.addEventListener("input", () =>
      this.change((state) => (state.background = [1, 3, 5].map((at) => decoded(parseInt(this.backgroundColour.value.slice(at, at + 2), 16) / 255))), "background"),
    );
    this.backgroundColour.addEventListener("change", () => this.viewer.endGesture());
    const open = this.fileButton("Open…", "image/*,.hdr", (file) => this.viewer.openBackground(file));
    return h("section", { "aria-label": "Background" }, h("h2", {}, "Background", open), h("div", { class: "row" }, this.backgroundKind, this.backgroundColour));
  }

  fileButton(label, accept, onfile) {
    const input = h("input", { type: "file", accept, hidden: true });
    input.addEventListener("change", () => input.files[0] && onfile(input.files[0]));
    const button = h("button", { type: "button", class: "quiet", onclick: () => ((input.value = ""), input.click()) }, label);
    return h("span", { class: "open" }, button, input);
  }

  view() {
    const options = LOOKS.map((look) => [look, LOOK_NAMES[look]]);
    this.look = choice(`look${this.id}`, "Look", options, (look) => this.change((state) => (state.look = look)));
    this.look.classList.add("looks");
    this.wipe = h("select", { "aria-label": "Wipe to" }, h("option", { value: "" }, "No wipe"), ...options.map(([value, text]) => h("option", { value }, `Wipe to ${text.toLowerCase()}`)));
    this.wipe.addEventListener("change", () => this.change((state) => (state.wipe = this.wipe.value ? { look: this.wipe.value, at: state.wipe?.at ?? 0.5 } : null)));
    this.exposure = this.bound("Exposure", "exposure", (state) => state, { min: -6, max: 6, step: 0.05, unit: "stops", low: -64, high: 64 });
    return h("section", { "aria-label": "View" }, h("h2", {}, "View", this.wipe), this.look, this.exposure);
  }

  out() {
    const { actions } = this.viewer;
    const button = (label, key, action) => h("button", { type: "button", title: `${label} (${key})`, onclick: action }, label);
    return h(
      "section",
      { class: "out", "aria-label": "Out" },
      button("Copy lights", "C", actions.copyLights),
      button("Copy command", "Shift C", actions.copyCommand),
      button("Copy link", "L", actions.copyLink),
      button("Save PNG", "Ctrl S", actions.save),
    );
  }

  /** Shows a state. */
  update(state) {
    const { viewer } = this;
    const active = new Set(shining(state));
    this.rows.forEach((row, index) => {
      const light = state.lights[index];
      row.element.hidden = !light;
      if (!light) return;
      row.element.classList.toggle("selected", index === state.selected);
      row.element.classList.toggle("off", !active.has(light));
      if (row.name.getRootNode().activeElement !== row.name) row.name.value = light.name;
      row.name.placeholder = `light${index + 1}`;
      for (const key of ["solo", "muted"]) row[key].setAttribute("aria-pressed", light[key]);
      paintBall(row.ball, [{ light, colour: chroma(power(light, viewer.tints)) }], 0.03);
    });
    const selected = state.lights[state.selected];
    this.add.disabled = state.lights.length >= LIGHTS;
    this.empty.hidden = state.lights.length > 0 || Boolean(state.environment);
    this.inspected.hidden = !selected;
    if (selected) {
      const lamp = isNear(selected);
      this.distance.set(lamp ? "near" : "far");
      for (const control of [...this.aims, this.softness]) control.hidden = lamp;
      for (const control of [...this.places, this.radius]) control.hidden = !lamp;
      [...this.aims, ...this.places, ...this.sliders].forEach((control) => control.refresh(state));
      this.inspected.classList.toggle("untinted", selected.temperature === null);
      this.swatch.value = toHex(selected.colour);
      const lit = [...active].map((light) => ({ light, colour: power(light, viewer.tints) }));
      paintBall(this.ball, lit);
    }
    this.environmentBody.hidden = !state.environment;
    this.environmentHint.hidden = Boolean(state.environment);
    if (state.environment) {
      this.environmentName.textContent = viewer.environment?.path ?? "";
      this.environmentMute.setAttribute("aria-pressed", state.environment.muted);
      const turn = ((((state.environment.rotation + 180) % 360) + 360) % 360) - 180;
      this.environmentSliders[0].set(turn);
      this.environmentSliders[1].refresh(state);
    }
    const kind = state.background === null ? "none" : state.background === "picture" ? "picture" : "colour";
    this.backgroundKind.set(kind);
    this.backgroundColour.hidden = kind !== "colour";
    if (kind === "colour") this.backgroundColour.value = viewer.hexOf(state.background);
    this.look.set(state.look);
    this.wipe.value = state.wipe?.look ?? "";
    this.exposure.refresh(state);
    this.undo.disabled = !viewer.past.length;
    this.redo.disabled = !viewer.future.length;
    this.play.setAttribute("aria-pressed", viewer.playing !== null);
  }
}

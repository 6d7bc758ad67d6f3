// The panel beside the picture: lights, the selected one, environment, background, view, and what goes out.

import { paintBall } from "./ball.js";
import { chroma, fromHex, toHex } from "./colour.js";
import { choice, h, iconButton, more } from "./dom.js";
import { LIGHTS } from "./engine.js";
import { Inspector } from "./inspector.js";
import { power } from "./lights.js";
import { grip } from "./sheet.js";
import { STOPS, bound } from "./sliders.js";
import { nameOf, shining } from "./state.js";
import { SURROUNDS } from "./surround.js";

export const LOOK_NAMES = {
  picture: "Picture",
  light: "Light",
  visibility: "Visibility",
  normals: "Normals",
  albedo: "Albedo",
  photograph: "Photo",
};

const FIRST_LOOKS = ["picture", "light", "photograph"]; // the others are seldom wanted by photographers

let serial = 0; // radio buttons of two pages in one notebook are apart

export class Controls {
  constructor(viewer) {
    this.viewer = viewer;
    this.id = ++serial;
    const { actions } = viewer;
    this.undo = iconButton("undo", "Undo", actions.undo, "Ctrl Z");
    this.redo = iconButton("redo", "Redo", actions.redo, "Ctrl Shift Z");
    this.play = iconButton("play", "Play an orbit", actions.orbit, "T");
    this.helpButton = iconButton("help", "Help", actions.help, "?");
    this.inspector = new Inspector(viewer, this.id);
    this.grip = grip(viewer);
    this.menu = iconButton("out", "Copy and save", () => this.openMenu(!this.outIsOpen));
    this.menu.classList.add("menu");
    this.menu.setAttribute("aria-expanded", "false");
    this.element = h(
      "aside",
      { class: "panel", "aria-label": "Lights and view" },
      h("header", {}, h("h1", {}, viewer.scene.title), this.play, this.undo, this.redo, this.helpButton, this.menu),
      this.lightList(),
      this.inspector.element,
      this.environment(),
      this.background(),
      this.view(),
      this.out(),
    );
    this.element.addEventListener("focusin", (event) => event.target.matches("header *") || this.grip.raise());
  }

  /** On a phone what goes out is a menu, which the header's last button opens. */
  openMenu(open) {
    this.outIsOpen = open;
    this.outSection.classList.toggle("open", open);
    this.menu.setAttribute("aria-expanded", String(open));
    if (open) this.outSection.querySelector("button").focus();
  }

  change(mutate, gesture) {
    this.viewer.change(mutate, gesture);
  }

  lightList() {
    const { actions } = this.viewer;
    this.rows = Array.from({ length: LIGHTS }, (_, index) => this.lightRow(index));
    this.add = iconButton("add", "Add a light", actions.add, "A");
    this.empty = h("p", { class: "hint" }, "No light: the person stands in the dark.");
    const share = { min: 0, max: 1, step: 0.01 };
    this.amount = bound(this.viewer, "Strength", "amount", (state) => state, { ...share, neutral: 1 });
    this.amount.title = "Of the new light: 0 is the photograph";
    this.fill = bound(this.viewer, "Fill", "fill", (state) => state, share);
    this.fill.title = "Light of the background in the shadows";
    return h(
      "section",
      { "aria-label": "Lights" },
      h("h2", {}, "Lights", this.add),
      h("ul", { class: "lights" }, ...this.rows.map(({ element }) => element)),
      this.empty,
      this.amount,
      this.fill,
    );
  }

  lightRow(index) {
    const { viewer } = this;
    const of = (state) => state.lights[index];
    const toggle = (key, letter) =>
      h(
        "button",
        {
          type: "button",
          class: `toggle ${key}`,
          onclick: () => this.change((state) => (of(state)[key] = !of(state)[key])),
        },
        letter,
      );
    const row = {
      ball: h("canvas", { width: 36, height: 36, "aria-hidden": "true" }),
      name: h("input", {
        type: "text",
        class: "name",
        maxlength: 80,
        spellcheck: "false",
        "aria-label": `Name of light ${index + 1}`,
      }),
      solo: toggle("solo", "S"),
      muted: toggle("muted", "M"),
      remove: iconButton("delete", "Delete", () => viewer.actions.remove(index)),
    };
    row.name.addEventListener("change", () => this.change((state) => (of(state).name = nameOf(row.name.value))));
    row.name.addEventListener("focus", () => viewer.select(index));
    row.element = h("li", {}, row.ball, row.name, row.solo, row.muted, row.remove);
    row.element.addEventListener("pointerdown", () => viewer.select(index));
    return row;
  }

  environment() {
    const of = (state) => state.environment;
    this.environmentName = h("span", { class: "file" });
    this.environmentSliders = [
      bound(this.viewer, "Rotation", "rotation", of, {
        min: -180,
        max: 180,
        step: 1,
        unit: "°",
        digits: 1,
        low: -1e6,
        high: 1e6,
      }),
      bound(this.viewer, "Strength", "exposure", of, STOPS),
    ];
    this.environmentMute = h(
      "button",
      {
        type: "button",
        class: "toggle muted",
        "aria-label": "Mute the environment",
        title: "Mute",
        onclick: () => this.change((state) => (of(state).muted = !of(state).muted)),
      },
      "M",
    );
    this.environmentRemove = iconButton("delete", "Remove the environment", () =>
      this.change((state) => (state.environment = null)),
    );
    this.environmentBody = h(
      "div",
      {},
      h("div", { class: "row" }, this.environmentName, this.environmentMute, this.environmentRemove),
      ...this.environmentSliders,
    );
    this.environmentHint = h(
      "p",
      { class: "hint" },
      "Drop a latitude-longitude map (.hdr or a picture) on this panel.",
    );
    const open = this.fileButton("Open…", this.viewer.host ? "" : ".hdr,.rgbe,.pic,image/*", (file) =>
      this.viewer.openEnvironment(file),
    );
    this.environmentSection = h(
      "section",
      { "aria-label": "Environment", "data-drop": "environment" },
      h("h2", {}, "Environment", open),
      this.environmentHint,
      this.environmentBody,
    );
    return this.environmentSection;
  }

  background() {
    this.backgroundKind = choice(
      `background${this.id}`,
      "Background",
      [
        ...(this.viewer.original ? [["original", "Original"]] : []),
        ["none", "None"],
        ["colour", "Colour"],
        ["picture", "Picture"],
      ],
      (kind) => this.viewer.setBackgroundKind(kind),
    );
    this.backgroundColour = h("input", { type: "color", "aria-label": "Background colour", value: "#1c1e22" });
    this.backgroundColour.addEventListener("input", () =>
      this.change((state) => (state.background = fromHex(this.backgroundColour.value)), "background"),
    );
    this.backgroundColour.addEventListener("change", () => this.viewer.endGesture());
    const open = this.fileButton("Open…", this.viewer.host ? "" : "image/*,.hdr", (file) =>
      this.viewer.openBackground(file),
    );
    const own = (state) => state;
    this.blur = bound(this.viewer, "Blur", "blur", own, { min: 0, max: 0.1, high: 0.2, step: 0.001, digits: 3 });
    this.blur.title = "Out of focus: the radius as a share of the picture's height";
    this.backgroundLight = bound(this.viewer, "Relit", "backgroundLight", own, { min: 0, max: 1, step: 0.01 });
    this.backgroundLight.title = "The new light reaches the background too: it darkens and tints";
    this.places = this.viewer.host?.places ? this.placing() : [];
    return h(
      "section",
      { "aria-label": "Background" },
      h("h2", {}, "Background", open),
      h("div", { class: "row" }, this.backgroundKind, this.backgroundColour),
      this.blur,
      this.backgroundLight,
      ...this.places,
      ...(this.viewer.host ? this.floor() : []),
    );
  }

  /** Where the person stands before another background, and how large. */
  placing() {
    const own = (state) => state.place;
    const shift = { min: -1, max: 1, step: 0.01 };
    const places = [
      bound(this.viewer, "Size", "scale", own, { min: 0.2, max: 2, low: 0.02, high: 20, step: 0.01, neutral: 1 }),
      bound(this.viewer, "Move right", "right", own, shift),
      bound(this.viewer, "Move up", "up", own, shift),
    ];
    places.forEach((control) => (control.title = "Of the person before another background than their own"));
    return places;
  }

  /** The switch of the shadow on the floor, which an application's server makes, and the floor's horizon. */
  floor() {
    const { actions } = this.viewer;
    this.floorSwitch = h("input", { type: "checkbox", role: "switch" });
    this.floorSwitch.addEventListener("change", () => actions.switchFloor());
    this.horizon = bound(this.viewer, "Horizon", "horizon", (state) => state.floor, {
      min: 0,
      max: 1,
      step: 0.01,
      neutral: 0.5,
    });
    return [h("label", { class: "row switch" }, this.floorSwitch, "Shadow on the floor"), this.horizon];
  }

  fileButton(label, accept, onfile) {
    const input = h("input", { type: "file", accept: accept || null, hidden: true });
    input.addEventListener("change", () => input.files[0] && onfile(input.files[0]));
    const button = h(
      "button",
      { type: "button", class: "quiet", onclick: () => ((input.value = ""), input.click()) },
      label,
    );
    return h("span", { class: "open" }, button, input);
  }

  view() {
    const options = this.viewer.engine.looks.map((look) => [look, LOOK_NAMES[look]]);
    const looks = (label, isShown) => {
      const shown = options.filter(([look]) => isShown(FIRST_LOOKS.includes(look)));
      const found = choice(`look${this.id}`, label, shown, (look) => this.change((state) => (state.look = look)));
      found.classList.add("looks");
      return found;
    };
    this.looks = [looks("Look", (isFirst) => isFirst), looks("Further looks", (isFirst) => !isFirst)];
    const further = this.looks[1].childElementCount ? [more("looks", this.looks[1])] : [];
    this.wipe = h(
      "select",
      { "aria-label": "Wipe to" },
      h("option", { value: "" }, "No wipe"),
      ...options.map(([value, text]) => h("option", { value }, `Wipe to ${text.toLowerCase()}`)),
    );
    this.wipe.addEventListener("change", () =>
      this.change(
        (state) => (state.wipe = this.wipe.value ? { look: this.wipe.value, at: state.wipe?.at ?? 0.5 } : null),
      ),
    );
    this.exposure = bound(this.viewer, "Exposure", "exposure", (state) => state, STOPS);
    this.gloss = bound(this.viewer, "Gloss", "gloss", (state) => state, { min: 0, max: 1, step: 0.01 });
    this.surround = choice(`surround${this.id}`, "Surround", SURROUNDS, (name) => this.viewer.setSurround(name));
    return h(
      "section",
      { "aria-label": "View" },
      h("h2", {}, "View", this.wipe),
      this.looks[0],
      this.exposure,
      this.gloss,
      h("div", { class: "row" }, h("span", { class: "label" }, "Surround"), this.surround),
      ...further,
    );
  }

  out() {
    const { actions } = this.viewer;
    const button = (label, key, action) =>
      h("button", { type: "button", title: key ? `${label} (${key})` : label, onclick: action }, label);
    const copy = (what, key, action) =>
      h(
        "button",
        {
          type: "button",
          class: "copy",
          title: `Copy ${what} (${key})`,
          "aria-label": `Copy ${what}`,
          onclick: action,
        },
        h("span", { class: "verb" }, "Copy "),
        what,
      );
    this.outSection = h(
      "section",
      { class: "out", "aria-label": "Copy and save" },
      h("span", { class: "label", "aria-hidden": "true" }, "Copy"),
      copy("lights", "C", actions.copyLights),
      copy("command", "Shift C", actions.copyCommand),
      ...(this.viewer.host ? [] : [copy("link", "L", actions.copyLink)]),
      copy("picture", "Ctrl C", actions.copyPicture),
      ...(this.viewer.host ? [button("Save files…", "", this.viewer.host.finish)] : []),
      button("Save PNG", "Ctrl S", actions.save),
    );
    this.outSection.addEventListener("click", (event) => event.target.closest("button") && this.openMenu(false));
    this.outSection.addEventListener("keydown", (event) => {
      if (event.key !== "Escape" || !this.outIsOpen) return;
      this.openMenu(false);
      this.menu.focus();
    });
    return this.outSection;
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
      const name = light.name || row.name.placeholder;
      for (const [key, does] of [
        ["solo", "Solo"],
        ["muted", "Mute"],
        ["remove", "Delete"],
      ]) {
        row[key].setAttribute("aria-label", `${does} ${name}`);
        row[key].title = `${does} ${name}`;
        if (key !== "remove") row[key].setAttribute("aria-pressed", light[key]);
      }
      paintBall(row.ball, [{ light, colour: chroma(power(light, viewer.tints)) }], 0.03);
    });
    this.add.disabled = state.lights.length >= LIGHTS;
    this.empty.hidden = state.lights.length > 0 || Boolean(state.environment);
    this.inspector.update(state);
    this.environmentBody.hidden = !state.environment;
    this.environmentHint.hidden = Boolean(state.environment);
    if (state.environment) {
      this.environmentName.textContent = viewer.environment?.path ?? "";
      this.environmentMute.setAttribute("aria-pressed", state.environment.muted);
      const turn = ((((state.environment.rotation + 180) % 360) + 360) % 360) - 180;
      this.environmentSliders[0].set(turn);
      this.environmentSliders[1].refresh(state);
    }
    const kind =
      state.background === null ? "none" : typeof state.background === "string" ? state.background : "colour";
    this.backgroundKind.set(kind);
    this.backgroundColour.hidden = kind !== "colour";
    if (kind === "colour") this.backgroundColour.value = toHex(state.background);
    this.fill.hidden = typeof state.background !== "string" || !viewer.backdrop?.light;
    this.fill.refresh(state);
    this.blur.hidden = typeof state.background !== "string";
    this.blur.refresh(state);
    this.backgroundLight.hidden = kind === "none";
    this.backgroundLight.refresh(state);
    for (const control of this.places) {
      control.hidden = kind === "original";
      control.refresh(state);
    }
    if (this.floorSwitch) {
      this.floorSwitch.checked = Boolean(state.floor);
      this.floorSwitch.disabled = kind === "none";
      this.horizon.hidden = !state.floor || kind === "none";
      this.horizon.refresh(state);
    }
    for (const look of this.looks) look.set(state.look);
    this.wipe.value = state.wipe?.look ?? "";
    this.exposure.refresh(state);
    this.gloss.refresh(state);
    this.amount.refresh(state);
    this.surround.set(viewer.root.dataset.surround);
    this.undo.disabled = !viewer.past.length;
    this.redo.disabled = !viewer.future.length;
    this.play.setAttribute("aria-pressed", viewer.playing !== null);
  }
}

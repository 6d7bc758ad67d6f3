// The third step: the viewer in place, with presets below it; stills by the server where the browser has no WebGL 2.

import {
  Viewer,
  backdropOf,
  blurOf,
  checkedLight,
  environmentText,
  fillOf,
  floorText,
  h,
  keyDown,
  keyUp,
  lampsOfRows,
  lightTexts,
  mapOf,
  placementOf,
  short,
} from "../viewer.js";
import { ServerBrush } from "./brush.js";
import { Confidence } from "./confidence.js";
import { FloorShadow } from "./floor.js";
import { Match } from "./match.js";
import { Plot } from "./plot.js";
import { presetsOf, withPreset } from "./presets.js";
import { ask, askJson } from "./requests.js";
import { StillEngine } from "./still.js";
import { THUMB, Thumbs, drawThumb } from "./thumbs.js";

export class Light {
  constructor(app) {
    this.app = app;
    this.rig = null; // what several photographs share: { state, maps, pictures }, and its { photograph, past, future }
    this.stale = false; // what is shown is of an analysis before the last
    this.toldStill = false; // the notice that the server draws comes once
    this.place = h("div", { class: "place" });
    this.presets = h("div", { class: "presets", role: "group", "aria-label": "Presets" });
    this.presets.addEventListener("keydown", (event) => keyDown(this.viewer, event)); // as on the picture
    this.presets.addEventListener("keyup", (event) => keyUp(this.viewer, event));
    this.brush = new ServerBrush(
      (viewer) => this.look(viewer),
      (error) => app.fail(error),
    );
    this.confidence = new Confidence((error) => app.fail(error));
    this.plot = new Plot(app, () => this.look());
    this.match = new Match(app, (viewer) => this.look(viewer));
    const aids = h("div", { class: "aids" });
    aids.append(this.brush.element, this.match.element, this.confidence.element, this.plot.element);
    const parts = [this.place, aids, this.presets];
    this.element = h("section", { class: "light", "aria-label": "Light" }, ...parts);
  }

  /** The photograph is analysed again: what is shown of it is old. */
  forget(photograph) {
    if (this.photograph === photograph) this.stale = true;
  }

  async open() {
    const { chosen } = this.app;
    if (this.photograph === chosen && !this.stale) return;
    await this.app.busy(async (say, signal) => {
      say("Opening the light");
      const address = `photographs/${chosen.id}`;
      const [scene, pack] = await Promise.all([
        askJson(`${address}/scene`, { signal }),
        ask(`${address}/pack`, { signal }),
      ]);
      const bytes = new Uint8Array(await pack.arrayBuffer());
      await this.begin(chosen, scene, bytes);
    });
  }

  focus() {
    if (!this.viewer) return;
    const { element } = this.viewer.stage;
    element.classList.add("by-hand"); // nobody has used a key here yet: no need to mark the focus
    element.focus({ preventScroll: true });
  }

  async begin(photograph, scene, bytes) {
    this.keepRig();
    this.viewer?.stop();
    this.viewer?.engine.close();
    this.viewer = null;
    const root = h("div", { class: "relight" });
    this.place.replaceChildren(root);
    const host = {
      environment: (file) => askJson(`environments?name=${encodeURIComponent(file.name)}`, { body: file }),
      background: (file) => askJson(`backgrounds?name=${encodeURIComponent(file.name)}`, { body: file }),
      original: scene.original && (await backdropOf(scene.original)), // without its person
      places: !photograph.movie,
      save: () => this.app.parts.save.save(".png"),
      finish: () => this.app.go("save"),
      engine: (viewer) =>
        new StillEngine(
          viewer,
          photograph,
          () => this.look(viewer),
          (error) => this.app.fail(error),
        ),
    };
    scene.photographed = [photograph.width, photograph.height];
    this.gains = scene.presetGains ?? {}; // of the presets' lights, for this person
    this.viewer = await Viewer.open(root, scene, bytes, false, host);
    if (!this.still)
      new FloorShadow(
        this.viewer,
        photograph,
        () => this.look(),
        (error) => this.app.fail(error),
      );
    this.restoreRig(photograph);
    this.confidence.attach(this.viewer, photograph);
    this.brush.attach(this.viewer, photograph);
    this.match.attach(this.viewer, photograph);
    this.photograph = photograph;
    this.stale = false;
    const { rig } = this;
    if (rig?.photograph && rig.photograph !== photograph)
      this.app.tell(`In the light of ${rig.photograph.name}.`, false, ["Start afresh", () => this.startAfresh()]);
    if (this.still && !this.toldStill)
      this.app.tell("This browser has no WebGL 2: the server makes each picture, which takes a moment.", true);
    this.toldStill = this.still;
    this.showPresets();
  }

  /** Whether the server makes the pictures. */
  get still() {
    return this.viewer?.engine instanceof StillEngine;
  }

  /** Where messages are shown. */
  noticePlace() {
    return this.viewer?.stage.element;
  }

  /** The rig as a page that is loaded again takes it: files by their ids. */
  keptRig() {
    this.keepRig();
    const { state, maps, pictures } = this.rig ?? {};
    return (
      state && { state, environment: state.environment && maps[state.map]?.id, picture: pictures[state.picture]?.id }
    );
  }

  /** Takes what `keptRig` gave; a file that is no longer there is left out. */
  async restore(kept) {
    if (!kept) return;
    const { state } = kept;
    const opened = (kind, id) => (id ? askJson(`${kind}/${id}`).catch(() => null) : null);
    const [environment, picture] = await Promise.all([
      opened("environments", kept.environment),
      opened("backgrounds", kept.picture),
    ]);
    const maps = [
      null,
      ...(environment ? [mapOf(environment.path, lampsOfRows(environment.lamps), environment.file)] : []),
    ];
    const pictures = [null, ...(picture ? [await backdropOf(picture)] : [])];
    state.lights = state.lights.map((light) => checkedLight(light));
    Object.assign(state, { map: maps.length - 1, picture: pictures.length - 1 });
    if (!environment) state.environment = null;
    if (!picture && state.background === "picture") state.background = null;
    this.rig = { state, maps, pictures };
  }

  /** Keeps the rig for the next photograph. */
  keepRig() {
    const { viewer, photograph } = this;
    if (!viewer) return;
    const { maps, pictures, past, future } = viewer;
    this.rig = { state: structuredClone(viewer.state), maps, pictures, photograph, past, future };
  }

  /**
   * Lights the photograph as the one before it; the first one softly from three sides, before its own background. One
   * that was analysed again keeps what can be undone.
   */
  restoreRig(photograph) {
    const { rig, viewer } = this;
    if (rig) {
      Object.assign(viewer, { maps: rig.maps, pictures: rig.pictures });
      const { place } = viewer.state; // of another photograph it says nothing
      viewer.change((state) =>
        Object.assign(state, rig.state, !rig.photograph || rig.photograph === photograph ? null : { place }),
      );
      if (rig.state.background === "original" && !viewer.original) viewer.setBackgroundKind("none");
    } else {
      const [first] = presetsOf(this.app.about.presets);
      viewer.change((state) =>
        Object.assign(state, this.withPreset(state, first), { background: viewer.original && "original" }),
      );
    }
    const same = rig?.photograph === photograph;
    [viewer.past, viewer.future] = same ? [rig.past, rig.future] : [[], []];
    viewer.refresh();
  }

  /** The light that a first photograph begins with, in place of the one before it. */
  startAfresh() {
    const { viewer } = this;
    const [first] = presetsOf(this.app.about.presets);
    this.app.hush();
    viewer.change((state) =>
      Object.assign(state, this.withPreset(state, first), {
        background: viewer.original && "original",
        environment: null,
        exposure: 0,
        amount: 1,
        fill: 0,
        blur: 0,
        backgroundLight: 0,
        place: { scale: 1, right: 0, up: 0 },
      }),
    );
  }

  /** What the server makes the picture of: as the copied command says it. */
  look({ state, environment, backdrop, scene } = this.viewer) {
    const settings = environment && environmentText(state);
    const { background } = state;
    return {
      lights: lightTexts(state),
      environment: settings ? { file: environment.id, settings } : null,
      background:
        background === "original"
          ? background
          : background === "picture"
            ? backdrop && { file: backdrop.id }
            : background && background.map(short),
      floor: floorText(state),
      placement: placementOf(state, scene.photographed),
      exposure: short(state.exposure),
      gloss: short(state.gloss),
      amount: short(state.amount),
      fill: short(fillOf(state, backdrop)),
      blur: short(blurOf(state)),
      backgroundLight: short(background ? state.backgroundLight : 0),
    };
  }

  // --- presets

  /** A state in the light of a preset, which leaves the face as bright as in the photograph. */
  withPreset(state, preset) {
    return withPreset(state, preset, this.gains[preset.id] ?? 1);
  }

  /** Lights the person by a preset. */
  apply(preset) {
    this.viewer.stop();
    this.viewer.change((state) => Object.assign(state, this.withPreset(state, preset)));
  }

  showPresets() {
    const { viewer } = this;
    const entries = presetsOf(this.app.about.presets).map((preset) => {
      const canvas = h("canvas", { width: THUMB[0], height: THUMB[1], "aria-hidden": "true" });
      const button = h(
        "button",
        { type: "button", class: "preset", "data-preset": preset.id, onclick: () => this.apply(preset) },
        canvas,
        h("span", {}, preset.name),
      );
      return { canvas, button, preset };
    });
    this.presets.replaceChildren(...entries.map(({ button }) => button));
    const draw = this.still ? this.askForPresets : this.drawPresets;
    setTimeout(() => this.app.trying(() => draw.call(this, viewer, entries)), 60);
  }

  /** Has the server make the pictures of the presets, one by one, after that of the light. */
  async askForPresets(viewer, entries) {
    const { photograph } = this;
    await viewer.engine.first;
    for (const { canvas, preset } of entries) {
      if (this.viewer !== viewer) break;
      const response = await ask(`photographs/${photograph.id}/presets/${preset.id}`);
      drawThumb(canvas, await createImageBitmap(await response.blob()));
    }
  }

  /** Draws the person in the light of each preset, as long as they are at hand. */
  async drawPresets(viewer, entries) {
    const thumbs = await Thumbs.of(viewer);
    for (const { canvas, preset } of entries) {
      if (this.viewer !== viewer) break;
      thumbs.draw(canvas, preset, this.gains[preset.id] ?? 1);
      await thumbs.drawn();
    }
    thumbs.close();
  }
}

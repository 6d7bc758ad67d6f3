// One page, or one widget in a notebook: the state, what changes it, and what shows it.

import { actionsOf } from "./actions.js";
import { PageBrush } from "./brush.js";
import { Controls } from "./controls.js";
import { h } from "./dom.js";
import { Draft } from "./draft.js";
import { Engine, LIGHTS } from "./engine.js";
import { Refused, lampsOf, readImage, turned } from "./environment.js";
import { Unsupported } from "./gl.js";
import { helpSheet, keyDown, keyTable, keyUp } from "./keys.js";
import { LUMINANCE, dot, isNear, power, samples } from "./lights.js";
import { backdropOf, lampsOfRows, mapOf } from "./opened.js";
import { unpack } from "./pack.js";
import { Room } from "./room.js";
import { Stage } from "./stage.js";
import {
  Invalid,
  checkedEnvironment,
  checkedLight,
  fillOf,
  fromFragment,
  initial,
  placeOf,
  shining,
  toFragment,
} from "./state.js";
import { preferredSurround, surround } from "./surround.js";

const ORBIT = 8000; // milliseconds a turn
const STEPS = 200; // that can be undone
const SLOW = 200; // milliseconds of a frame, beyond which a drag needs a draft; two such frames decide
const REST = 300; // milliseconds without a change, after which a draft gives way to the picture
const GREY = [0.0116, 0.0129, 0.0161]; // of a background that becomes a colour

export class Viewer {
  /**
   * In `root`, from a scene (see relight/viewer/scene.py) and a pack; `linked`: whether the page's address holds the
   * state.
   * `host`: the application around it, if any: { environment(file), background(file), original, save(), finish(),
   * engine(viewer), floorShadow(look) }. `original` is the whole photograph as a backdrop, or null; its engine draws
   * where the browser has no
   * WebGL 2.
   */
  static async open(root, scene, bytes, linked, host = null) {
    const pack = await unpack(bytes);
    /** @type {ImageBitmapOptions} */
    const exact = { colorSpaceConversion: "none", premultiplyAlpha: "none" };
    const [photograph, albedo] = await Promise.all(
      [pack.files.photograph, pack.files.albedo].map((file) => createImageBitmap(file, exact)),
    );
    pack.images = { photograph, albedo };
    return new Viewer(root, scene, pack, linked, host).begin();
  }

  constructor(root, scene, pack, linked, host) {
    this.root = root;
    this.scene = scene;
    this.pack = pack;
    this.linked = linked;
    this.host = host;
    this.tints = scene.tints;
    this.past = [];
    this.future = [];
    this.gesture = null;
    this.playing = null;
    this.bare = false;
    this.held = false;
    this.drawn = Array(LIGHTS + 2).fill({}); // of each slot: the settings that its samples are of
    // What was opened, which states name by number: 0 is the scene's, and stays empty where it has none.
    this.maps = [null]; // { path, lamps, strength }
    this.pictures = [null]; // { name, width, height, rgb }
    this.listeners = new Set();
    this.timed = []; // milliseconds of the first frames
    this.draft = null; // draws the picture smaller, where those were slow
    this.brush = null; // an application has its own
    this.room = new Room(pack);
    this.state = initial(scene);
  }

  async begin() {
    const { scene } = this;
    if (scene.environment) {
      this.maps[0] = mapOf(scene.environment.path, lampsOfRows(scene.environment.lamps));
    }
    if (scene.backdrop) this.pictures[0] = await backdropOf(scene.backdrop);
    this.actions = actionsOf(this);
    this.keys = keyTable(this);
    this.stage = new Stage(this);
    this.engine = this.newEngine();
    this.setSurround(preferredSurround(), false);
    this.controls = new Controls(this);
    this.help = helpSheet(this, this.keys);
    this.root.replaceChildren(this.stage.element, this.controls.grip, this.controls.element, this.help);
    this.listen();
    if (this.linked) this.readLink();
    this.stage.layout();
    if (!this.host) this.stage.hold((this.brush = new PageBrush()));
    this.redraw();
    this.refresh();
    return this;
  }

  newEngine() {
    try {
      return new Engine(this.stage.canvas, this.pack, this.room, SHADERS);
    } catch (error) {
      if (!(error instanceof Unsupported) || !this.host) throw error;
      return this.host.engine(this);
    }
  }

  /** The environment map and the picture behind the person that the state names, or null. */
  get environment() {
    return this.maps[this.state.map] ?? null;
  }

  get backdrop() {
    return (this.state.background === "original" ? this.original : this.pictures[this.state.picture]) ?? null;
  }

  /** The whole photograph, which an application has. */
  get original() {
    return this.host?.original ?? null;
  }

  listen() {
    const { root, stage } = this;
    root.addEventListener("keydown", (event) => keyDown(this, event));
    root.addEventListener("keyup", (event) => keyUp(this, event));
    root.addEventListener(
      "pointerdown",
      (event) => event.target.closest?.(".out, .menu") || this.controls.openMenu(false),
    );
    root.addEventListener("dragover", (event) => event.preventDefault());
    root.addEventListener("drop", (event) => this.drop(event));
    stage.canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    stage.canvas.addEventListener("webglcontextrestored", () => {
      this.engine.restore();
      this.redraw();
    });
    if (this.linked) {
      // Keys work wherever the focus is; in a notebook only within the widget.
      document.addEventListener("keydown", (event) => root.contains(event.target) || keyDown(this, event));
      document.addEventListener("keyup", (event) => root.contains(event.target) || keyUp(this, event));
      // Nothing fails in the console alone.
      const fail = (error) => this.say(`Something went wrong in this page: ${error?.message ?? error}`, true);
      addEventListener("error", (event) => fail(event.error));
      addEventListener("unhandledrejection", (event) => fail(event.reason));
      addEventListener("hashchange", () => location.hash.slice(1) !== this.link && this.readLink());
    }
  }

  // --- changing

  /** Changes the state; what has the same `gesture` as the change before it is undone together with it. */
  change(mutate, gesture = null) {
    const before = JSON.stringify(this.state);
    const state = structuredClone(this.state);
    mutate(state);
    if (JSON.stringify(state) === before) return;
    if (gesture === null || gesture !== this.gesture) {
      this.past.push(JSON.parse(before));
      if (this.past.length > STEPS) this.past.shift();
      this.future = [];
    }
    this.gesture = gesture;
    this.state = state;
    if (gesture !== null && JSON.stringify(this.past.at(-1)) === JSON.stringify(state)) {
      this.past.pop(); // it is back where it began: nothing is left to undo
      this.gesture = null;
    }
    this.refresh();
  }

  endGesture() {
    this.gesture = null;
    if (this.draft?.shown) this.drawSoon();
  }

  select(index) {
    if (index >= this.state.lights.length || index === this.state.selected) return;
    this.stop(); // an orbit is that of the light that was selected
    this.state = { ...this.state, selected: index };
    this.refresh();
  }

  /** Undo, or redo. */
  step(from, to) {
    this.stop();
    if (!from.length) return;
    to.push(this.state);
    this.state = from.pop();
    this.endGesture();
    this.refresh();
  }

  play() {
    if (!this.state.lights.length) return;
    const start = performance.now();
    const begun = this.state.lights[this.state.selected];
    const turn = (now) => {
      const orbited = turnedLight(begun, (360 * Math.max(0, now - start)) / ORBIT);
      this.change((state) => Object.assign(state.lights[state.selected], orbited), "orbit");
      this.playing = requestAnimationFrame(turn);
    };
    this.playing = requestAnimationFrame(turn);
    this.refresh();
  }

  stop() {
    if (this.playing === null) return;
    cancelAnimationFrame(this.playing);
    this.playing = null;
    this.endGesture();
    this.refresh();
  }

  /** Shows the photograph while a key is held. */
  hold(held) {
    this.held = held;
    this.redraw();
  }

  // --- files

  async drop(event) {
    event.preventDefault();
    const file = event.dataTransfer?.files[0];
    if (!file) return;
    const onPanel = event.target.closest?.(".panel");
    if (onPanel || /\.(hdr|exr)$/i.test(file.name)) await this.openEnvironment(file);
    else await this.openBackground(file);
  }

  async openEnvironment(file) {
    await this.tryFile(async () => {
      const found = this.host ? await this.host.environment(file) : null;
      this.maps.push(
        found
          ? mapOf(found.path, lampsOfRows(found.lamps), found.file)
          : mapOf(file.name, lampsOf(await readImage(file))),
      );
      this.change((state) => Object.assign(state, { environment: checkedEnvironment({}), map: this.maps.length - 1 }));
      this.say(`The environment is ${file.name}`);
    });
  }

  async openBackground(file) {
    await this.tryFile(async () => {
      this.pictures.push(this.host ? await backdropOf(await this.host.background(file)) : await readImage(file));
      this.change((state) => Object.assign(state, { background: "picture", picture: this.pictures.length - 1 }));
      this.say(`The background is ${file.name}`);
    });
  }

  async tryFile(open) {
    try {
      await open();
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      this.say(error.message, true);
    }
  }

  /** Shows the picture before a dark, mid-grey or light surround; in an application all of its page. */
  setSurround(name, keep = true) {
    surround([this.root, this.root.closest(".relight-app")].filter(Boolean), name, keep);
    this.refresh();
  }

  setBackgroundKind(kind) {
    if (kind === "picture" && !this.pictures[this.state.picture]) {
      this.say("Drop a picture on the person, or open one.");
      this.refresh();
      return;
    }
    this.change((state) => (state.background = kind === "none" ? null : kind === "colour" ? GREY : kind));
  }

  // --- showing

  /** Says so while a lamp is where none can stand. */
  checkLamps() {
    const { lights } = this.state;
    const lamp = lights[this.state.selected];
    const blocked = lamp && isNear(lamp) ? this.room.obstacle(lamp) : null;
    if (blocked !== this.blocked && (blocked || this.blocked)) {
      if (blocked) this.say(`${lamp.name || "The lamp"} ${blocked}: move it beside them, or Python refuses it.`, true);
      else this.stage.message.replaceChildren();
    }
    this.blocked = blocked;
  }

  /** Brings all up to date with the state, the picture with the browser's next frame. */
  refresh() {
    if (!this.controls) return;
    this.drawSoon();
    clearTimeout(this.writing);
    if (this.linked) this.writing = setTimeout(() => this.writeLink(), 250);
    for (const listener of this.listeners) listener(this.state);
  }

  drawSoon() {
    this.frame ??= requestAnimationFrame(() => {
      this.frame = null;
      const active = /** @type {HTMLButtonElement} */ (document.activeElement);
      const focused = this.root.contains(active) && active;
      if (this.draft?.engine.lost === false) this.drawDraft();
      else this.drawTimed();
      this.controls.update(this.state);
      this.stage.update(this.state);
      this.checkLamps();
      // Keys are heard where the focus is: it must not fall out of the page with a row, a handle or a button.
      if (focused && (focused.disabled || focused.closest("[hidden]")))
        this.stage.element.focus({ preventScroll: true });
    });
  }

  /** Draws, and takes the time of the first frames; after two slow ones drags are drawn smaller. */
  drawTimed() {
    const measured = this.host && this.timed.length < 3 && this.engine instanceof Engine && !this.engine.lost;
    const began = performance.now();
    this.redraw();
    if (!measured) return;
    this.engine.finish();
    this.timed.push(performance.now() - began);
    if (this.timed.length === 3 && this.timed.slice(1).every((time) => time > SLOW)) this.openDraft();
  }

  async openDraft() {
    this.draft = await Draft.of(this);
    if (!this.stage.message.textContent) this.say("This browser draws slowly: while you drag, the picture is coarser.");
  }

  /** Draws the picture smaller, and as it is once nothing has changed for a while. */
  drawDraft() {
    this.draft.draw(this);
    this.showDraft(true);
    clearTimeout(this.resting);
    if (this.gesture === null && this.playing === null) this.resting = setTimeout(() => this.redraw(), REST);
  }

  showDraft(shown) {
    this.draft.shown = shown;
    this.draft.engine.canvas.hidden = !shown;
  }

  redraw() {
    const { engine, state } = this;
    if (engine.lost) return;
    if (this.draft) this.showDraft(false);
    if (engine.backdrop !== this.backdrop) engine.setBackground(this.backdrop);
    engine.setLights(this.layersOf(state), state.gloss, state.amount);
    this.showOn(engine);
  }

  /** Shows the state's look with an engine that has its lights. */
  showOn(engine) {
    const { state } = this;
    const { exposure, backgroundLight, blur } = state;
    engine.place = placeOf(state);
    const settings = { exposure, backgroundLight, blur, background: this.shownBackground() };
    if (this.held) engine.show("photograph", settings);
    else if (state.wipe) {
      engine.show(state.look, { ...settings, part: [0, state.wipe.at] });
      engine.show(state.wipe.look, { ...settings, part: [state.wipe.at, 1] });
    } else engine.show(state.look, settings);
  }

  shownBackground() {
    const { background } = this.state;
    return typeof background === "string" ? this.backdrop && "picture" : background;
  }

  /** What the engine draws, a slot a light, the environment last. */
  layersOf(state) {
    const active = new Set(shining(state));
    const layers = Array.from({ length: LIGHTS }, (_, slot) => {
      const light = state.lights[slot];
      if (!light || !active.has(light)) return null;
      const settings = isNear(light)
        ? [...light.position, light.radius]
        : [light.azimuth, light.elevation, light.angle];
      return { samples: this.samplesOf(slot, settings, () => samples(light)), colour: power(light, this.tints) };
    });
    layers.push(this.surroundings(state));
    return layers;
  }

  /** The environment, the background's light that fills, both as one, or null. */
  surroundings(state) {
    const { environment } = state;
    const shines = environment && this.environment && !environment.muted;
    const fill = fillOf(state, this.backdrop);
    const colour = shines && power(environment, this.tints).map((value) => value * this.environment.strength);
    const around = shines && {
      samples: this.samplesOf(LIGHTS, [`map ${state.map}`, environment.rotation], () =>
        turned(this.environment.lamps, environment.rotation),
      ),
      colour,
    };
    if (!fill) return around || null;
    const { light } = this.backdrop;
    const strength = fill * light.strength;
    if (!around) return { samples: light.lamps, colour: [strength, strength, strength] };
    const whole = dot(LUMINANCE, colour) + strength;
    const times = (lamps, factors) =>
      lamps.map((lamp) => ({ ...lamp, power: lamp.power.map((value, channel) => value * factors[channel]) }));
    return {
      samples: this.samplesOf(
        LIGHTS + 1,
        [`map ${state.map}`, environment.rotation, ...colour, state.background, state.picture, fill],
        () => [
          ...times(
            around.samples,
            colour.map((value) => value / whole),
          ),
          ...times(light.lamps, Array(3).fill(strength / whole)),
        ],
      ),
      colour: [whole, whole, whole],
    };
  }

  samplesOf(slot, settings, make) {
    const key = settings.join(); // of three numbers or of four: a lamp's is no distant light's
    if (this.drawn[slot].key !== key) this.drawn[slot] = { key, samples: make() };
    return this.drawn[slot].samples;
  }

  /**
   * Lights, as Python's DirectionalLight and PointLight have them, to {width, height, data}: linear premultiplied
   * RGBA. `amount`: the rest is the photograph.
   */
  async render(lights, gloss = 0, amount = 1) {
    const given = lights.map((light) => checkedLight(light));
    const blocked = given
      .filter(isNear)
      .map((lamp) => this.room.obstacle(lamp))
      .find(Boolean);
    if (blocked) throw new Invalid(`position: ${blocked}; expected a light beside them.`);
    let picture = null;
    for (let first = 0; first < Math.max(1, given.length); first += LIGHTS) {
      const layers = Array.from({ length: LIGHTS + 1 }, (_, slot) => {
        const light = slot < LIGHTS ? given[first + slot] : undefined;
        return light ? { samples: samples(light), colour: power(light, this.tints) } : null;
      });
      this.engine.setLights(layers, gloss, amount, first ? 0 : 1 - amount);
      const part = this.engine.read();
      if (picture) part.data.forEach((value, index) => index % 4 < 3 && (picture.data[index] += value));
      else picture = part;
    }
    this.drawSoon();
    return picture;
  }

  /** A sentence for whoever is there; `kept` until it is closed. */
  say(text, kept = false) {
    const { message } = this.stage;
    clearTimeout(this.saying);
    message.replaceChildren(text);
    if (kept)
      message.append(
        h("button", { type: "button", class: "quiet", onclick: () => message.replaceChildren() }, "Close"),
      );
    else this.saying = setTimeout(() => message.replaceChildren(), 3500);
  }

  async copy(what, text) {
    try {
      await navigator.clipboard.writeText(text);
      this.say(`${what}: copied.`);
    } catch {
      const area = h("textarea", { readonly: true, rows: 8, "aria-label": what });
      area.value = text;
      const sheet = h(
        "dialog",
        { class: "help" },
        h("form", { method: "dialog" }, h("h2", {}, `${what}, to copy`), h("button", { class: "quiet" }, "Close")),
        area,
      );
      sheet.addEventListener("close", () => sheet.remove());
      this.root.append(sheet);
      sheet.showModal();
      area.select();
    }
  }

  // --- links

  readLink() {
    this.link = location.hash.slice(1);
    try {
      const missing = [];
      const state = fromFragment(this.link, initial(this.scene), this, (name) => missing.push(name));
      this.change((now) => Object.assign(now, state));
      if (missing.length)
        this.say(
          `This page does not have ${missing.join(" and ")}, which the link shows: drop ${missing.length > 1 ? "them" : "it"} here again.`,
          true,
        );
    } catch (error) {
      if (!(error instanceof Invalid)) throw error;
      this.say(`This link cannot be used. ${error.message}`, true);
    }
  }

  writeLink() {
    if (location.hash.slice(1) !== this.link) return; // another one is about to be read
    history.replaceState(null, "", `#${toFragment(this.state, this)}`);
    this.link = location.hash.slice(1); // as the browser encodes it
  }
}

/** Where a light stands after a turn about the vertical, from the camera toward image right. */
function turnedLight(light, degrees) {
  if (isNear(light)) return { position: turned([{ toward: light.position }], degrees)[0].toward };
  return { azimuth: ((((light.azimuth + degrees + 180) % 360) + 360) % 360) - 180 };
}

// One page, or one widget in a notebook: the state, what changes it, and what shows it.

import { actionsOf } from "./actions.js";
import { toHex } from "./ball.js";
import { Controls } from "./controls.js";
import { h } from "./dom.js";
import { Engine, LIGHTS, LUMINANCE, Unsupported } from "./engine.js";
import { Refused, encoded, lampsOf, readImage, turned } from "./environment.js";
import { actionOf, helpSheet, keyTable } from "./keys.js";
import { angles, dot, isNear, power, samples } from "./lights.js";
import { fromBase64, unpack } from "./pack.js";
import { Room } from "./room.js";
import { Stage, unprojected } from "./stage.js";
import { Invalid, checkedEnvironment, checkedLight, fromFragment, initial, shining, toFragment, toYaml, toCommand } from "./state.js";

const ORBIT = 8000; // milliseconds a turn
const STEPS = 200; // that can be undone
const GREY = [0.0116, 0.0129, 0.0161]; // of a background that becomes a colour

export class Viewer {
  /** In `root`, from a scene (see relight/viewer/scene.py) and a pack; `linked`: whether the page's address holds the state. */
  static async open(root, scene, bytes, linked) {
    const pack = await unpack(bytes);
    const exact = { colorSpaceConversion: "none", premultiplyAlpha: "none" };
    const [photograph, albedo] = await Promise.all(
      [pack.files.photograph, pack.files.albedo].map((file) => createImageBitmap(file, exact)),
    );
    pack.images = { photograph, albedo };
    return new Viewer(root, scene, pack, linked).begin();
  }

  constructor(root, scene, pack, linked) {
    Object.assign(this, { root, scene, pack, linked, tints: scene.tints });
    Object.assign(this, { past: [], future: [], gesture: null, playing: null, bare: false, held: false });
    this.drawn = Array(LIGHTS + 1).fill({}); // of each slot: the settings that its samples are of
    this.environment = null; // { path, lamps, strength }
    this.backdrop = null; // { name, width, height, rgb }
    this.listeners = new Set();
    this.room = new Room(pack);
    this.state = initial(scene);
  }

  async begin() {
    const { scene } = this;
    if (scene.environment) {
      const lamps = scene.environment.lamps.map((lamp) => ({ toward: lamp.slice(0, 3), power: lamp.slice(3) }));
      this.setEnvironment(scene.environment.path, lamps);
    }
    if (scene.backdrop) {
      this.backdrop = await readImage(new File([fromBase64(scene.backdrop.data)], scene.backdrop.name));
    }
    this.actions = actionsOf(this);
    this.keys = keyTable(this);
    this.stage = new Stage(this);
    this.engine = new Engine(this.stage.canvas, this.pack, this.room, SHADERS);
    if (this.backdrop) this.engine.setBackground(this.backdrop);
    this.controls = new Controls(this);
    this.help = helpSheet(this.keys);
    this.root.replaceChildren(this.stage.element, this.controls.element, this.help);
    this.listen();
    if (this.linked) this.readLink();
    this.stage.layout();
    this.redraw();
    this.refresh();
    return this;
  }

  listen() {
    const { root, stage } = this;
    root.addEventListener("keydown", (event) => this.key(event));
    root.addEventListener("keyup", (event) => this.keyUp(event));
    root.addEventListener("dragover", (event) => event.preventDefault());
    root.addEventListener("drop", (event) => this.drop(event));
    stage.canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    stage.canvas.addEventListener("webglcontextrestored", () => {
      this.engine.restore();
      this.redraw();
    });
    if (this.linked) {
      // Keys work wherever the focus is; in a notebook only within the widget.
      document.addEventListener("keydown", (event) => root.contains(event.target) || this.key(event));
      document.addEventListener("keyup", (event) => root.contains(event.target) || this.keyUp(event));
      addEventListener("hashchange", () => location.hash.slice(1) !== this.written && this.readLink());
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
    this.refresh();
  }

  endGesture() {
    this.gesture = null;
  }

  select(index) {
    if (index >= this.state.lights.length || index === this.state.selected) return;
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

  key(event) {
    this.stage.element.classList.remove("by-hand");
    if (this.help.open || event.target.matches?.("input[type=text], select, textarea")) return;
    if (event.target.matches?.("input") && /^Arrow/.test(event.key)) return;
    if (event.target.matches?.(".divider") && /^Arrow(Left|Right)$/.test(event.key)) {
      this.actions.moveWipe(event.key === "ArrowLeft" ? -0.02 : 0.02);
      event.preventDefault();
      return;
    }
    if (event.key === " ") {
      if (event.target.matches?.("button:not(.handle), input")) return;
      if (!this.held) this.hold(true);
      event.preventDefault();
      return;
    }
    const action = actionOf(this.keys, event);
    if (!action) return;
    event.preventDefault();
    if (action !== this.actions.orbit) this.stop();
    action(event);
  }

  keyUp(event) {
    if (event.key === " " && this.held) this.hold(false);
    this.endGesture();
  }

  /** Shows the photograph while a key is held. */
  hold(held) {
    this.held = held;
    this.redraw();
  }

  /** The sphere in the panel is a handle too. */
  holdBall(ball) {
    const aim = (event) => {
      if (!ball.hasPointerCapture(event.pointerId)) return;
      const bounds = ball.getBoundingClientRect();
      const right = ((event.clientX - bounds.left) / bounds.width) * 2 - 1;
      const up = 1 - ((event.clientY - bounds.top) / bounds.height) * 2;
      const toward = unprojected(right, up);
      this.change((state) => {
        const light = state.lights[state.selected];
        const metres = isNear(light) && Math.hypot(...light.position);
        Object.assign(light, metres ? { position: toward.map((part) => part * metres) } : angles(toward));
      }, "ball");
    };
    ball.addEventListener("pointerdown", (event) => {
      this.stop();
      ball.setPointerCapture(event.pointerId);
      aim(event);
    });
    ball.addEventListener("pointermove", aim);
    ball.addEventListener("pointerup", () => this.endGesture());
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
      const image = await readImage(file);
      this.setEnvironment(file.name, lampsOf(image));
      this.change((state) => (state.environment = checkedEnvironment({})));
      this.say(`The environment is ${file.name}`);
    });
  }

  async openBackground(file) {
    await this.tryFile(async () => {
      this.backdrop = await readImage(file);
      this.engine.setBackground(this.backdrop);
      this.change((state) => (state.background = "picture"));
      this.redraw();
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

  /** A map's lamps, scaled so that half floats hold their sum. */
  setEnvironment(path, lamps) {
    const strength = lamps.reduce((sum, lamp) => sum + dot(LUMINANCE, lamp.power), 0) || 1;
    this.environment = { path, strength, lamps: lamps.map((lamp) => ({ ...lamp, power: lamp.power.map((value) => value / strength) })) };
    this.drawn[LIGHTS] = {};
  }

  setBackgroundKind(kind) {
    if (kind === "picture" && !this.backdrop) {
      this.say("Drop a picture on the person, or open one.");
      this.refresh();
      return;
    }
    this.change((state) => (state.background = kind === "none" ? null : kind === "picture" ? "picture" : GREY));
  }

  hexOf(colour) {
    const codes = colour.map((value) => Math.round(255 * encoded(Math.min(1, value))));
    return `#${codes.map((code) => code.toString(16).padStart(2, "0")).join("")}`;
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
    if (!this.engine) return;
    this.drawSoon();
    clearTimeout(this.writing);
    if (this.linked) this.writing = setTimeout(() => this.writeLink(), 250);
    for (const listener of this.listeners) listener(this.state);
  }

  drawSoon() {
    this.frame ??= requestAnimationFrame(() => {
      this.frame = null;
      this.redraw();
      this.controls.update(this.state);
      this.stage.update(this.state);
      this.checkLamps();
    });
  }

  redraw() {
    const { engine, state } = this;
    if (engine.gl.isContextLost()) return;
    engine.setLights(this.layersOf(state));
    const settings = { exposure: state.exposure, background: this.shownBackground() };
    if (this.held) engine.show("photograph", settings);
    else if (state.wipe) {
      engine.show(state.look, { ...settings, part: [0, state.wipe.at] });
      engine.show(state.wipe.look, { ...settings, part: [state.wipe.at, 1] });
    } else engine.show(state.look, settings);
  }

  shownBackground() {
    const { background } = this.state;
    return background === "picture" && !this.backdrop ? null : background;
  }

  /** What the engine draws, a slot a light, the environment last. */
  layersOf(state) {
    const active = new Set(shining(state));
    const layers = Array.from({ length: LIGHTS }, (_, slot) => {
      const light = state.lights[slot];
      if (!light || !active.has(light)) return null;
      const settings = isNear(light) ? [...light.position, light.radius] : [light.azimuth, light.elevation, light.angle];
      return { samples: this.samplesOf(slot, settings, () => samples(light)), colour: power(light, this.tints) };
    });
    const { environment } = state;
    const shines = environment && this.environment && !environment.muted;
    layers.push(
      shines && {
        samples: this.samplesOf(LIGHTS, [environment.rotation], () => turned(this.environment.lamps, environment.rotation)),
        colour: power(environment, this.tints).map((value) => value * this.environment.strength),
      },
    );
    return layers;
  }

  samplesOf(slot, settings, make) {
    const key = settings.join(); // of three numbers or of four: a lamp's is no distant light's
    if (this.drawn[slot].key !== key) this.drawn[slot] = { key, samples: make() };
    return this.drawn[slot].samples;
  }

  /** Lights, as Python's DirectionalLight and PointLight have them, to {width, height, data}: linear premultiplied RGBA. */
  async render(lights) {
    const given = lights.map((light) => checkedLight(light));
    const blocked = given.filter(isNear).map((lamp) => this.room.obstacle(lamp)).find(Boolean);
    if (blocked) throw new Invalid(`position: ${blocked}; expected a light beside them.`);
    let picture = null;
    for (let first = 0; first < Math.max(1, given.length); first += LIGHTS) {
      const layers = Array.from({ length: LIGHTS + 1 }, (_, slot) => {
        const light = slot < LIGHTS ? given[first + slot] : undefined;
        return light ? { samples: samples(light), colour: power(light, this.tints) } : null;
      });
      this.engine.setLights(layers);
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
    if (kept) message.append(h("button", { type: "button", class: "quiet", onclick: () => message.replaceChildren() }, "Close"));
    else this.saying = setTimeout(() => message.replaceChildren(), 3500);
  }

  async copy(what, text) {
    try {
      await navigator.clipboard.writeText(text);
      this.say(`${what} can be pasted now.`);
    } catch {
      const area = h("textarea", { readonly: true, rows: 8, "aria-label": what });
      area.value = text;
      const sheet = h("dialog", { class: "help" }, h("form", { method: "dialog" }, h("h2", {}, `${what}, to copy`), h("button", { class: "quiet" }, "Close")), area);
      sheet.addEventListener("close", () => sheet.remove());
      this.root.append(sheet);
      sheet.showModal();
      area.select();
    }
  }

  // --- links

  readLink() {
    try {
      const state = fromFragment(location.hash.slice(1), initial(this.scene));
      this.change((now) => Object.assign(now, state));
    } catch (error) {
      if (!(error instanceof Invalid)) throw error;
      this.say(`This link cannot be used. ${error.message}`, true);
    }
  }

  writeLink() {
    this.written = toFragment(this.state);
    history.replaceState(null, "", `#${this.written}`);
  }
}

/** Where a light stands after a turn about the vertical, from the camera toward image right. */
function turnedLight(light, degrees) {
  if (isNear(light)) return { position: turned([{ toward: light.position }], degrees)[0].toward };
  return { azimuth: ((((light.azimuth + degrees + 180) % 360) + 360) % 360) - 180 };
}

/** Says in place of a picture why there is none. */
function explain(root, error) {
  const known = error instanceof Unsupported;
  root.replaceChildren(h("p", { class: "sorry", role: "alert" }, known ? error.message : `The page cannot be shown: ${error.message}`));
}

/** The page: its data lies in script elements. */
export async function openPage(page) {
  const root = page.getElementById("viewer");
  try {
    const scene = JSON.parse(page.getElementById("scene").textContent);
    const viewer = await Viewer.open(root, scene, fromBase64(page.getElementById("pack").textContent), true);
    window.relight = api(viewer);
  } catch (error) {
    explain(root, error);
    if (!(error instanceof Unsupported)) throw error;
  }
}

/** What programs may do with a page. */
const api = (viewer) => ({
  render: (lights) => viewer.render(lights),
  lights: () => toYaml(viewer.state, viewer.environment),
  command: () => toCommand(viewer.state, viewer.environment, viewer.scene, viewer.backdrop?.name),
  viewer,
});

/** The widget of a notebook (anywidget): its lights are those that shine, in Python and here. */
export async function render({ model, el }) {
  const root = h("div", { class: "relight embedded" });
  el.append(root);
  try {
    const view = model.get("pack");
    const viewer = await Viewer.open(root, model.get("scene"), new Uint8Array(view.buffer, view.byteOffset, view.byteLength), false);
    const plain = (state) => shining(state).map(({ muted, solo, ...light }) => light);
    let told = JSON.stringify(plain(viewer.state));
    viewer.listeners.add((state) => {
      const lights = plain(state);
      if (JSON.stringify(lights) === told) return;
      told = JSON.stringify(lights);
      model.set("lights", lights);
      model.save_changes();
    });
    model.on("change:lights", () => {
      const lights = model.get("lights").map((light) => checkedLight(light));
      if (JSON.stringify(lights.map(({ muted, solo, ...light }) => light)) === told) return;
      viewer.change((state) => Object.assign(state, { lights, selected: Math.max(0, Math.min(state.selected, lights.length - 1)) }));
    });
    return () => viewer.stop();
  } catch (error) {
    explain(root, error);
  }
}

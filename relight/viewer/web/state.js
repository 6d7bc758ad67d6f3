// What the page shows, as plain data: checked when it comes from outside, and written out again as a link, as
// a lights file and as a command.

import { LOCI, isNear } from "./lights.js";
import { LIGHTS, LOOKS } from "./engine.js";

/** Something from outside that cannot be used, in a sentence. */
export class Invalid extends Error {}

export const { SHARED, RANGES } = PYTHON; // what all lights have; { parameter: [low, high] }, null for no limit
const IN_PLACE = { scale: 1, right: 0, up: 0 }; // about the picture's middle; shares of its width and height
const SWITCHES = { muted: false, solo: false };
const LIGHT = { name: "", azimuth: 0, elevation: 0, ...SHARED, angle: 0, ...SWITCHES };
const LAMP = { name: "", position: [0, 0, 1], ...SHARED, radius: 0, ...SWITCHES };

/** A light with all its parameters, from some of them; Invalid for what its class in Python refuses. */
export function checkedLight(given, kind = isNear(given) ? LAMP : LIGHT) {
  const light = { ...kind };
  for (const [key, value] of Object.entries(given)) {
    if (!Object.hasOwn(light, key)) throw new Invalid(`${key}: is no parameter of a light.`);
    if (value === undefined) continue;
    light[key] = value;
  }
  for (const [key, [low, high]] of Object.entries(RANGES)) {
    if (!(key in light)) continue;
    const value = light[key];
    if (
      typeof value !== "number" ||
      !Number.isFinite(value) ||
      (low !== null && value < low) ||
      (high !== null && value > high)
    ) {
      throw new Invalid(`${key}: expected a number${low !== null ? ` from ${low} to ${high}` : ""}, got ${value}.`);
    }
  }
  const { colour, locus, temperature, position } = light;
  if (position && !isPlace(position)) throw new Invalid(`position: expected three numbers of metres, got ${position}.`);
  const whole = Array.isArray(colour) && colour.length === 3;
  if (!whole || !colour.every((value) => Number.isFinite(value) && value >= 0 && value <= 1e6)) {
    throw new Invalid(`colour: expected three numbers from 0 up, got ${colour}.`);
  }
  if (!Object.hasOwn(LOCI, locus)) throw new Invalid(`locus: expected planckian or daylight, got ${locus}.`);
  const [low, high] = LOCI[locus];
  if (temperature !== null && !(temperature >= low && temperature <= high)) {
    throw new Invalid(`temperature: expected ${low} to ${high} kelvin, got ${temperature}.`);
  }
  if (typeof light.name !== "string" && light.name !== null) throw new Invalid("name: expected text.");
  return { ...light, name: nameOf(light.name), colour: [...colour], ...(position && { position: [...position] }) };
}

const isPlace = (position) =>
  Array.isArray(position) && position.length === 3 && position.every((value) => Math.abs(value) <= 1e6);

/** A name as OpenEXR layers can have it: no control characters, not too long. */
export const nameOf = (text) =>
  (text ?? "")
    .replace(/\p{Cc}/gu, "")
    .trim()
    .slice(0, 80);

/** The environment's part of the state: its map is kept elsewhere. */
export const checkedEnvironment = (given) =>
  checkedLight(given, { name: "environment", ...SHARED, rotation: 0, muted: false });

/** The state that a scene from Python begins with. */
export function initial(scene) {
  return {
    lights: scene.lights.slice(0, LIGHTS).map((light) => checkedLight(light)),
    selected: 0,
    environment: scene.environment ? checkedEnvironment(scene.environment.settings) : null,
    map: 0, // which of the viewer's environment maps lights the person, and which picture is behind them
    picture: 0,
    background: scene.background ?? null, // null, [r, g, b] linear, "picture", or "original" in an application
    place: { ...IN_PLACE }, // in an application: of the photograph, before a background that is not its own
    floor: null, // in an application { horizon: a share of the height from the top }: the person casts a shadow on it
    look: "picture",
    wipe: null, // or { look, at }: what is right of `at`, a share of the width
    exposure: 0,
    gloss: scene.gloss ?? 0, // strength of the reflection at grazing angles, from 0 to 1
    amount: scene.amount ?? 1, // of the lights, from 0 to 1: the rest is the photograph's own
    blur: scene.blur ?? 0, // of the background: its radius as a share of the picture's height
    backgroundLight: scene.backgroundLight ?? 0, // share of the new light that reaches the background
    fill: scene.fill ?? 0, // share of the background's light that fills shadows, where the page knows it
  };
}

/** The lights that shine: what is muted, or beside a solo, does not. */
export function shining({ lights }) {
  const alone = lights.some((light) => light.solo);
  return lights.filter((light) => !light.muted && (!alone || light.solo));
}

// --- links

/**
 * The state as a link's fragment; lights are written as the command line takes them.
 * `files`: { environment, backdrop }, whose names are written where they were dropped on the page: the link has no more
 * of them.
 */
export function toFragment(state, files = {}) {
  const query = new URLSearchParams();
  for (const light of state.lights) query.append("light", asText(light));
  const numbers = (test) => state.lights.flatMap((light, index) => (test(light) ? [index + 1] : [])).join(" ");
  const set = (key, value) => value && query.set(key, value);
  if (!state.lights.length) query.set("light", "none");
  set(
    "muted",
    numbers((light) => light.muted),
  );
  set(
    "solo",
    numbers((light) => light.solo),
  );
  set("selected", state.selected ? state.selected + 1 : "");
  if (state.environment) {
    query.set("environment", asText({ ...state.environment, name: "" }, ["rotation"]));
    set("dark", state.environment.muted ? "1" : "");
    set("map", state.map ? files.environment?.path : "");
  } else query.set("environment", "none");
  if (state.background === "picture") set("picture", state.picture ? files.backdrop?.name : "");
  if (state.background) query.set("background", [state.background].flat().map(short).join("/"));
  set("look", state.look === "picture" ? "" : state.look);
  set("wipe", state.wipe && `${state.wipe.look}@${short(state.wipe.at)}`);
  set("exposure", state.exposure ? short(state.exposure) : "");
  set("gloss", state.gloss ? short(state.gloss) : "");
  set("amount", state.amount === 1 ? "" : short(state.amount));
  for (const key of ["fill", "blur", "backgroundLight"]) set(key, state[key] ? short(state[key]) : "");
  return query.toString();
}

/**
 * The state that a fragment says, upon what `base` has; Invalid if it says what cannot be.
 * `files`: the { maps, pictures } of the page. `lack` is told the name of a file that they do not have.
 */
export function fromFragment(fragment, base, { maps = [], pictures = [] } = {}, lack = null) {
  const query = new URLSearchParams(fragment);
  const state = structuredClone(base);
  if (query.has("light")) {
    const texts = query.getAll("light").filter((text) => text !== "none");
    if (texts.length > LIGHTS)
      throw new Invalid(`The link has ${texts.length} lights; the page shows up to ${LIGHTS}.`);
    state.lights = texts.map((text) => checkedLight(parsed(text)));
    for (const key of ["muted", "solo"]) {
      for (const number of (query.get(key) ?? "").split(" ").filter(Boolean)) {
        const light = state.lights[Number(number) - 1];
        if (light) light[key] = true;
      }
    }
    Object.assign(state, { background: null, gloss: 0, amount: 1, fill: 0, blur: 0, backgroundLight: 0 });
  }
  state.selected = Math.min(
    Math.max(numberOf("selected", query.get("selected") ?? "1") - 1, 0),
    Math.max(state.lights.length - 1, 0),
  );
  if (query.get("environment") === "none") state.environment = null;
  else if (query.has("environment")) {
    const [name, muted] = [query.get("map"), query.has("dark")];
    state.map = name === null ? 0 : maps.findIndex((map) => map?.path === name);
    if (maps[state.map]) {
      const given = parsed(`:${query.get("environment")}`);
      state.environment = checkedEnvironment({ ...given, name: base.environment?.name ?? "environment", muted });
    } else {
      Object.assign(state, { environment: null, map: 0 });
      lack?.(name ?? "the environment");
    }
  }
  if (query.has("background")) {
    const [text, name] = [query.get("background"), query.get("picture")];
    state.picture = name === null ? 0 : pictures.findIndex((picture) => picture?.name === name);
    if (text !== "picture") {
      state.background = checkedColour("background", text.split("/").map(Number));
      state.picture = 0;
    } else if (pictures[state.picture]) state.background = text;
    else {
      Object.assign(state, { background: null, picture: 0 });
      lack?.(name ?? "the background");
    }
  }
  if (query.has("look")) state.look = checkedLook(query.get("look"));
  if (query.has("wipe")) {
    const [look, at] = query.get("wipe").split("@");
    state.wipe = { look: checkedLook(look), at: Math.min(Math.max(numberOf("wipe", at), 0), 1) };
  }
  state.exposure = checkedExposure(numberOf("exposure", query.get("exposure") ?? 0));
  for (const key of ["gloss", "amount", "fill", "blur", "backgroundLight"]) {
    if (query.has(key)) state[key] = checkedShare(key, numberOf(key, query.get(key)));
  }
  return state;
}

function checkedLook(look) {
  if (!LOOKS.includes(look)) throw new Invalid(`look: expected ${LOOKS.join(", ")}, got ${look}.`);
  return look;
}

function checkedColour(name, colour) {
  if (colour.length !== 3 || !colour.every((value) => Number.isFinite(value) && value >= 0)) {
    throw new Invalid(`${name}: expected three numbers, red/green/blue.`);
  }
  return colour;
}

function checkedExposure(exposure) {
  if (Math.abs(exposure) > 64) throw new Invalid(`exposure: expected -64 to 64 stops, got ${exposure}.`);
  return exposure;
}

function checkedShare(name, value) {
  if (!(value >= 0 && value <= 1)) throw new Invalid(`${name}: expected 0 to 1, got ${value}.`);
  return value;
}

function numberOf(name, text) {
  const value = Number(text);
  if (text === "" || !Number.isFinite(value)) throw new Invalid(`${name}: expected a number, got ${text}.`);
  return value;
}

// --- texts that Python reads

/** A number of seven digits, as Python and YAML read it: YAML takes an exponent only after a point. */
export function short(value) {
  if (typeof value !== "number") return value;
  const text = String(Number(value.toPrecision(7)));
  return text.includes("e") && !text.includes(".") ? text.replace("e", ".0e") : text;
}

const placing = (light) => (isNear(light) ? ["position"] : ["azimuth", "elevation"]);

/** The settings of a light that are not its defaults, as [key, value]; where it is always. */
function settings(light, first) {
  const keys = ["intensity", "colour", "exposure", "temperature", "locus", "angle", "radius"];
  const told = keys.filter((key) => key in light && String(light[key]) !== String({ ...LIGHT, ...LAMP }[key]));
  return [...first, ...told].map((key) => [key, light[key]]);
}

/** `name:azimuth=-40,elevation=30,colour=1/0.9/0.8`, as `relight apply --light` takes it. */
export function asText(light, first = placing(light)) {
  const parts = settings(light, first).map(([key, value]) => `${key}=${[value].flat().map(short).join("/")}`);
  return `${light.name ? `${light.name}:` : ""}${parts.join(",")}`;
}

function parsed(text) {
  const colon = text.lastIndexOf(":");
  const given = { name: text.slice(0, Math.max(colon, 0)) };
  for (const part of text
    .slice(colon + 1)
    .split(",")
    .filter(Boolean)) {
    const [key, value] = part.split("=");
    const numbers = (value ?? "")
      .split("/")
      .map((number) => numberOf(key, number === "" ? NaN : key === "locus" ? 0 : number));
    given[key] = key === "locus" ? value : key === "colour" || key === "position" ? numbers : numbers[0];
  }
  return given;
}

/** Lights with names that no other has, as a lights file wants them. */
function named(lights) {
  const taken = new Set();
  return lights.map((light, index) => {
    let name = light.name || `light${index + 1}`;
    for (let number = 2; taken.has(name); number++) name = `${light.name || "light"} ${number}`;
    taken.add(name);
    return { ...light, name };
  });
}

/** A lights file, as relight.read_lights reads it, of the lights that shine. */
export function toYaml(state, environment) {
  const lines = ["lights:"];
  const entry = (light, first, extra = []) => {
    lines.push(`  - name: ${JSON.stringify(light.name)}`, ...extra.map((line) => `    ${line}`));
    for (const [key, value] of settings(light, first)) {
      const text = Array.isArray(value) ? `[${value.map(short).join(", ")}]` : short(value);
      lines.push(`    ${key}: ${text}`);
    }
  };
  for (const light of named(shining(state))) entry(light, placing(light), isNear(light) ? ["type: point"] : []);
  if (environment && environmentText(state)) {
    entry(state.environment, ["rotation"], ["type: environment", `image: ${JSON.stringify(environment.path)}`]);
  }
  return lines.length > 1 ? `${lines.join("\n")}\n` : "lights: []\n";
}

/** The lights that shine, each as `relight apply --light` takes it. */
export const lightTexts = (state) => named(shining(state)).map((light) => asText(light));

/** The environment's settings, as `relight apply --environment` takes them after its path; null where none shines. */
export const environmentText = (state) =>
  state.environment && !state.environment.muted ? asText({ ...state.environment, name: "" }, ["rotation"]) : null;

/** The `relight apply` command that makes the same picture. */
export function toCommand(state, environment, scene, backdrop, output = "relit.png") {
  const words = [...scene.command];
  const placement = scene.photographed && placementOf(state, scene.photographed);
  if (placement) words.push("--scale", placement.scale, "--offset", placement.offset.join("/"));
  for (const text of lightTexts(state)) words.push("--light", text);
  const settings = environment && environmentText(state);
  if (settings) words.push("--environment", `${environment.path},${settings}`);
  if (state.background === "picture") words.push(...(backdrop?.name ? ["--background", backdrop.name] : []));
  else if (!state.background && (scene.opaque || scene.backdrop?.name === "plate"))
    words.push("--background", "none"); // or the photograph would keep its own
  else if (Array.isArray(state.background)) words.push("--background", state.background.map(short).join("/"));
  const floor = floorText(state);
  if (floor) words.push("--floor", floor);
  if (fillOf(state, backdrop)) words.push("--fill", "background", "--fill-amount", short(state.fill));
  if (blurOf(state)) words.push("--background-blur", short(state.blur));
  if (state.background && state.backgroundLight) words.push("--background-light", short(state.backgroundLight));
  if (state.gloss) words.push("--gloss", short(state.gloss));
  if (state.amount !== 1) words.push("--amount", short(state.amount));
  if (state.exposure) words.push("--exposure", short(state.exposure));
  words.push("-o", output);
  return words.map((word) => quoted(String(word))).join(" ");
}

/** Where the photograph is in the picture: before its own background where it was taken. */
export const placeOf = ({ place, background }) => (background === "original" || !place ? IN_PLACE : place);

/** Where a place of the photograph comes to be in the picture; both in shares of width and height. */
export const placed = ({ scale, right, up }, [x, y]) => [(x - 0.5) * scale + 0.5 + right, (y - 0.5) * scale + 0.5 - up];

/** The place of the photograph that is at one of the picture. */
export const unplaced = ({ scale, right, up }, [x, y]) => [
  (x - 0.5 - right) / scale + 0.5,
  (y - 0.5 + up) / scale + 0.5,
];

/** The placement as the command takes it: { scale, offset }, in pixels of a photograph of `size`; null for none. */
export function placementOf(state, size) {
  const { scale, right, up } = placeOf(state);
  const offset = [right * size[0], up * size[1]].map(Math.round);
  return scale === 1 && !offset.some(Boolean) ? null : { scale: short(scale), offset };
}

/** The share of the background's light that fills; 0 where none is behind the person whose light is known. */
export const fillOf = ({ background, fill }, backdrop) =>
  typeof background === "string" && backdrop?.light ? fill : 0;

/** The blur of the background; a colour has none. */
export const blurOf = ({ background, blur }) => (typeof background === "string" ? blur : 0);

/** The floor as the command takes it; null where no background shows its shadow. */
export const floorText = ({ floor, background }) => (floor && background ? `horizon=${short(floor.horizon)}` : null);

/** A word as a POSIX shell takes it. */
const quoted = (word) => (/^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`);

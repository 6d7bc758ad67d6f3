// What the page shows, as plain data: checked when it comes from outside, and written out again as a link, as
// a lights file and as a command.

import { LOCI, isNear } from "./lights.js";
import { LIGHTS, LOOKS } from "./engine.js";

/** Something from outside that cannot be used, in a sentence. */
export class Invalid extends Error {}

const BLANK = {
  intensity: 1,
  colour: [1, 1, 1],
  exposure: 0,
  temperature: null,
  locus: "planckian",
};
const SWITCHES = { muted: false, solo: false };
const LIGHT = { name: "", azimuth: 0, elevation: 0, ...BLANK, angle: 0, ...SWITCHES };
const LAMP = { name: "", position: [0, 0, 1], ...BLANK, radius: 0, ...SWITCHES };
const RANGES = {
  azimuth: [-Infinity, Infinity],
  elevation: [-90, 90],
  intensity: [0, 1e6],
  exposure: [-64, 64],
  angle: [0, 180],
  radius: [0, 1e6],
  rotation: [-Infinity, Infinity],
};

export const LIMITS = RANGES;

/** A light with all its parameters, from some of them; Invalid for what its class in Python refuses. */
export function checkedLight(given, kind = isNear(given) ? LAMP : LIGHT) {
  const light = { ...kind };
  for (const [key, value] of Object.entries(given)) {
    if (!(key in light)) throw new Invalid(`${key}: is no parameter of a light.`);
    if (value === undefined) continue;
    light[key] = value;
  }
  for (const [key, [low, high]] of Object.entries(RANGES)) {
    if (!(key in light)) continue;
    const value = light[key];
    if (typeof value !== "number" || !Number.isFinite(value) || value < low || value > high) {
      throw new Invalid(`${key}: expected a number${Number.isFinite(low) ? ` from ${low} to ${high}` : ""}, got ${value}.`);
    }
  }
  const { colour, locus, temperature, position } = light;
  if (position && !isPlace(position)) throw new Invalid(`position: expected three numbers of metres, got ${position}.`);
  const whole = Array.isArray(colour) && colour.length === 3;
  if (!whole || !colour.every((value) => Number.isFinite(value) && value >= 0 && value <= 1e6)) {
    throw new Invalid(`colour: expected three numbers from 0 up, got ${colour}.`);
  }
  if (!(locus in LOCI)) throw new Invalid(`locus: expected planckian or daylight, got ${locus}.`);
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
export const nameOf = (text) => (text ?? "").replace(/\p{Cc}/gu, "").trim().slice(0, 80);

/** The environment's part of the state: its map is kept elsewhere. */
export const checkedEnvironment = (given) =>
  checkedLight(given, { name: "environment", ...BLANK, rotation: 0, muted: false });

/** The state that a scene from Python begins with. */
export function initial(scene) {
  return {
    lights: scene.lights.slice(0, LIGHTS).map((light) => checkedLight(light)),
    selected: 0,
    environment: scene.environment ? checkedEnvironment(scene.environment.settings) : null,
    background: scene.background ?? null, // null, [r, g, b] linear, or "picture"
    look: "picture",
    wipe: null, // or { look, at }: what is right of `at`, a share of the width
    exposure: 0,
  };
}

/** The lights that shine: what is muted, or beside a solo, does not. */
export function shining({ lights }) {
  const alone = lights.some((light) => light.solo);
  return lights.filter((light) => !light.muted && (!alone || light.solo));
}

// --- links

/** The state as a link's fragment; lights are written as the command line takes them. */
export function toFragment(state) {
  const query = new URLSearchParams();
  for (const light of state.lights) query.append("light", asText(light));
  const numbers = (test) => state.lights.flatMap((light, index) => (test(light) ? [index + 1] : [])).join(" ");
  const set = (key, value) => value && query.set(key, value);
  if (!state.lights.length) query.set("light", "none");
  set("muted", numbers((light) => light.muted));
  set("solo", numbers((light) => light.solo));
  set("selected", state.selected ? state.selected + 1 : "");
  if (state.environment) {
    query.set("environment", asText({ ...state.environment, name: "" }, ["rotation"]));
    set("dark", state.environment.muted ? "1" : "");
  }
  if (state.background) query.set("background", [state.background].flat().map(short).join("/"));
  set("look", state.look === "picture" ? "" : state.look);
  set("wipe", state.wipe && `${state.wipe.look}@${short(state.wipe.at)}`);
  set("exposure", state.exposure ? short(state.exposure) : "");
  return query.toString();
}

/** The state that a fragment says, upon what `base` has; Invalid if it says what cannot be. */
export function fromFragment(fragment, base) {
  const query = new URLSearchParams(fragment);
  const state = structuredClone(base);
  if (query.has("light")) {
    const texts = query.getAll("light").filter((text) => text !== "none");
    if (texts.length > LIGHTS) throw new Invalid(`The link has ${texts.length} lights; the page shows up to ${LIGHTS}.`);
    state.lights = texts.map((text) => checkedLight(parsed(text)));
    for (const key of ["muted", "solo"]) {
      for (const number of (query.get(key) ?? "").split(" ").filter(Boolean)) {
        if (state.lights[number - 1]) state.lights[number - 1][key] = true;
      }
    }
    state.background = null;
  }
  state.selected = Math.min(Math.max(numberOf("selected", query.get("selected") ?? 1) - 1, 0), Math.max(state.lights.length - 1, 0));
  if (query.has("environment") && state.environment) {
    const muted = query.has("dark");
    const given = parsed(`:${query.get("environment")}`);
    state.environment = checkedEnvironment({ ...given, name: state.environment.name, muted });
  }
  if (query.has("background")) {
    const text = query.get("background");
    state.background = text === "picture" ? text : checkedColour("background", text.split("/").map(Number));
  }
  if (query.has("look")) state.look = checkedLook(query.get("look"));
  if (query.has("wipe")) {
    const [look, at] = query.get("wipe").split("@");
    state.wipe = { look: checkedLook(look), at: Math.min(Math.max(numberOf("wipe", at), 0), 1) };
  }
  state.exposure = checkedExposure(numberOf("exposure", query.get("exposure") ?? 0));
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

function numberOf(name, text) {
  const value = Number(text);
  if (text === "" || !Number.isFinite(value)) throw new Invalid(`${name}: expected a number, got ${text}.`);
  return value;
}

// --- texts that Python reads

/** A number of few digits: 1e-4 is the precision of an angle. */
export const short = (value) => (typeof value === "number" ? String(Number(value.toFixed(4))) : value);

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
  for (const part of text.slice(colon + 1).split(",").filter(Boolean)) {
    const [key, value] = part.split("=");
    const numbers = (value ?? "").split("/").map((number) => numberOf(key, number === "" ? NaN : key === "locus" ? 0 : number));
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
  if (environment && !state.environment.muted) {
    entry(state.environment, ["rotation"], ["type: environment", `image: ${JSON.stringify(environment.path)}`]);
  }
  return lines.length > 1 ? `${lines.join("\n")}\n` : "lights: []\n";
}

/** The `relight apply` command that makes the same picture. */
export function toCommand(state, environment, scene, backgroundName) {
  const words = [...scene.command];
  for (const light of named(shining(state))) words.push("--light", asText(light));
  if (environment && !state.environment.muted) {
    words.push("--environment", `${environment.path},${asText({ ...state.environment, name: "" }, ["rotation"])}`);
  }
  if (state.background === "picture") words.push("--background", backgroundName);
  else if (state.background) words.push("--background", state.background.map(short).join("/"));
  if (state.exposure) words.push("--exposure", short(state.exposure));
  words.push("-o", "relit.png");
  return words.map(quoted).join(" ");
}

/** A word as a POSIX shell takes it. */
const quoted = (word) => (/^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`);

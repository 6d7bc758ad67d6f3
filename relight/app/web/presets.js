// Lighting that photographers know by name: those of relight/presets.yaml, which the server sends.

import { checkedLight } from "../viewer.js";

const HEIGHT = 1.75; // metres of the person for whom the file is written

/** [{id, name, lights, gloss}] of the file, for a person so many metres high. */
export function presetsFor(file, height) {
  return Object.entries(file).map(([id, { title, lights, gloss }]) => ({
    id,
    name: title,
    lights: lights.map((light) => scaled(light, height / HEIGHT)),
    gloss: gloss ?? 0,
  }));
}

/** A lamp in proportion to the person, as bright for them: light falls off with the square of the distance. */
function scaled(light, scale) {
  if (!light.position) return light;
  return {
    ...light,
    position: light.position.map((place) => Number((scale * place).toFixed(3))),
    radius: Number((scale * light.radius).toFixed(3)),
    exposure: Number(((light.exposure ?? 0) + 2 * Math.log2(scale)).toFixed(2)),
  };
}

/** A state with the light of a preset in place of its own; an environment is muted. */
export function withPreset(state, { lights, gloss }) {
  return {
    ...state,
    lights: lights.map((given) => checkedLight(given)),
    gloss,
    selected: 0,
    environment: state.environment && { ...state.environment, muted: true },
  };
}

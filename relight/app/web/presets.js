// Lighting that photographers know by name: those of relight/presets.yaml, which the server sends.

import { checkedLight } from "../viewer.js";

/** [{id, name, lights, gloss}] of the file, for a person of the height that a photograph's person is taken to have. */
export const presetsOf = (file) =>
  Object.entries(file).map(([id, { title, lights, gloss }]) => ({ id, name: title, lights, gloss: gloss ?? 0 }));

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

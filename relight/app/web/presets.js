// Lighting that photographers know by name: those of relight/presets.yaml, which the server sends.

import { checkedLight } from "../viewer.js";

/** [{id, name, lights, gloss}] of the file, for a person of the height that a photograph's person is taken to have. */
export const presetsOf = (file) =>
  Object.entries(file).map(([id, { title, lights, gloss }]) => ({ id, name: title, lights, gloss: gloss ?? 0 }));

/** The lights of a preset of `gain` times the intensity, written in few digits. */
export const lightsOf = ({ lights }, gain) =>
  lights
    .map((given) => checkedLight(given))
    .map((light) => ({ ...light, intensity: Number((light.intensity * gain).toPrecision(3)) }));

/** A state with the light of a preset in place of its own, all of it; an environment is muted. */
export function withPreset(state, preset, gain) {
  return {
    ...state,
    lights: lightsOf(preset, gain),
    gloss: preset.gloss,
    selected: 0,
    environment: state.environment && { ...state.environment, muted: true },
  };
}

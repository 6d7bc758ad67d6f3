// Lighting that photographers know by name. Angles in degrees: azimuth from the camera toward image right.

import { checkedLight } from "../viewer.js";

const light = (name, azimuth, elevation, settings = {}) => ({ name, azimuth, elevation, angle: 10, ...settings });

/** Lamps on the ground before the person: they flicker no more than a photograph does. */
const fire = (height) => {
  const lamp = (name, place, exposure, temperature) => {
    const position = place.map((share) => Number((share * height).toFixed(3)));
    // As bright at the person's middle, whatever their size: light falls off with the square of the distance.
    const reach = Number((exposure + 2 * Math.log2(Math.hypot(...position))).toFixed(2));
    return { name, position, radius: Number((0.05 * height).toFixed(3)), exposure: reach, temperature };
  };
  return [lamp("fire", [0.22, -0.34, 0.5], 0.2, 2000), lamp("embers", [-0.28, -0.38, 0.44], -1.2, 1800), light("moon", 155, 45, { exposure: -2, temperature: 9000 })];
};

/** [id, name, the lights of a room in which the person is so many metres high]. */
export const PRESETS = [
  ["three-point", "Three-point", () => [light("key", -40, 30, { angle: 12 }), light("fill", 45, 8, { angle: 50, exposure: -1.8 }), light("rim", 150, 35, { exposure: 0.4 })]],
  ["rembrandt", "Rembrandt", () => [light("key", -50, 42, { angle: 8, exposure: 0.2 }), light("fill", 60, 5, { angle: 60, exposure: -3.2 })]],
  ["butterfly", "Butterfly", () => [light("key", 0, 48, { angle: 8 }), light("reflector", 0, -25, { angle: 60, exposure: -2.2 })]],
  ["split", "Split", () => [light("key", -92, 8, { angle: 8, exposure: 0.4 })]],
  ["rim", "Rim", () => [light("rim left", -132, 25, { exposure: 1.6 }), light("rim right", 136, 30, { exposure: 1.4 }), light("fill", 0, 10, { angle: 60, exposure: -2.8 })]],
  ["window", "Window", () => [light("window", -72, 15, { angle: 60, exposure: 0.5, temperature: 6800 }), light("wall", 80, 0, { angle: 90, exposure: -2.8, temperature: 4600 })]],
  ["overcast", "Overcast", () => [light("sky", 0, 75, { angle: 170, exposure: 0.1, temperature: 7200 }), light("horizon", 0, 12, { angle: 140, exposure: -1, temperature: 7000 })]],
  ["golden-hour", "Golden hour", () => [light("sun", 68, 9, { angle: 2, exposure: 0.5, temperature: 2900 }), light("sky", -50, 50, { angle: 150, exposure: -1.8, temperature: 9500 })]],
  ["stage", "Stage", () => [light("spot", 8, 58, { angle: 4 }), light("left", -112, 12, { colour: [0.12, 0.3, 1], exposure: 1.4 }), light("right", 116, 12, { colour: [1, 0.12, 0.4], exposure: 1.4 })]],
  ["firelight", "Firelight", fire],
];

/** A state with the lights of a preset in place of its own; an environment is muted. */
export function withPreset(state, lights) {
  return {
    ...state,
    lights: lights.map((given) => checkedLight(given)),
    selected: 0,
    environment: state.environment && { ...state.environment, muted: true },
  };
}

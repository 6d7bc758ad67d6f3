// Lights as Python's: the parameters of relight.DirectionalLight and relight.PointLight, and the directions that
// a distant light comes down to.

// SOFT_SAMPLES: directions over the disc of a soft light. LOCI: kelvin. See relight/viewer/constants.py.
export const { LOCI, LUMINANCE, SOFT_SAMPLES } = PYTHON;
export const DEGREE = Math.PI / 180;

/** Whether a light stands in the room, at a position. */
export const isNear = (light) => "position" in light;

/** Unit vector toward a light, of a near one from the subject's middle: x to image right, y up, z to the camera. */
export function direction(light) {
  if (isNear(light)) return light.position.some(Boolean) ? normalised(light.position) : [0, 0, 1];
  const { azimuth, elevation } = light;
  const across = Math.cos(elevation * DEGREE);
  return [across * Math.sin(azimuth * DEGREE), Math.sin(elevation * DEGREE), across * Math.cos(azimuth * DEGREE)];
}

/**
 * { azimuth, elevation } in degrees of a vector.
 * @param {number[]} vector
 */
export function angles([x, y, z]) {
  return { azimuth: Math.atan2(x, z) / DEGREE, elevation: Math.atan2(y, Math.hypot(x, z)) / DEGREE };
}

/** Degrees across a light, of a near one as the subject's middle sees it. */
export function softness(light) {
  if (!isNear(light)) return light.angle;
  return (2 * Math.asin(Math.min(1, light.radius / Math.max(Math.hypot(...light.position), 1e-6)))) / DEGREE;
}

/** Linear RGB: colour × the temperature's tint × intensity × 2 ** exposure. */
export function power(light, tints) {
  const tint = light.temperature === null ? [1, 1, 1] : tintOf(light.temperature, light.locus, tints);
  const strength = light.intensity * 2 ** light.exposure;
  return light.colour.map((value, channel) => value * tint[channel] * strength);
}

/** Irradiance at the subject's middle on a surface that faces the light: what a light meter held there reads. */
export function irradiance(light, tints) {
  const luminance = dot(LUMINANCE, power(light, tints));
  return isNear(light) ? luminance / Math.max(dot(light.position, light.position), 1e-6) : luminance;
}

/** Linear Rec.709 of a colour temperature, from Python's table in equal steps of mired. */
function tintOf(kelvin, locus, tints) {
  const { mired, colours } = tints[locus];
  const place = Math.max(0, (1e6 / kelvin - mired[0]) / mired[1]);
  const index = Math.min(Math.floor(place), colours.length - 2);
  const share = place - index;
  return colours[index].map((low, channel) => low + (colours[index + 1][channel] - low) * share);
}

/** What a light of unit power comes down to: [{ toward, power: [r, g, b] }]; of a near one it is the lamp. */
export function samples(light) {
  if (isNear(light)) return { position: light.position, radius: light.radius };
  const axis = direction(light);
  const towards = light.angle === 0 ? [axis] : cap(axis, (light.angle / 2) * DEGREE);
  const facing = towards.reduce((sum, toward) => sum + dot(toward, axis), 0);
  return towards.map((toward) => ({ toward, power: [1 / facing, 1 / facing, 1 / facing] }));
}

/** Directions over a spherical cap, in equal areas along a golden-angle spiral, as Python's `_cap`. */
function cap(axis, radius) {
  const smallest = axis.map(Math.abs).reduce((best, value, index, all) => (value < all[best] ? index : best), 0);
  const aside = normalised(
    cross(
      axis,
      [0, 1, 2].map((index) => Number(index === smallest)),
    ),
  );
  const other = cross(axis, aside);
  return Array.from({ length: SOFT_SAMPLES }, (_, step) => {
    const along = 1 - ((1 - Math.cos(radius)) * (step + 0.5)) / SOFT_SAMPLES;
    const across = Math.sqrt(1 - along * along);
    const turn = Math.PI * (3 - Math.sqrt(5)) * step;
    const [a, b] = [across * Math.cos(turn), across * Math.sin(turn)];
    return axis.map((value, index) => a * aside[index] + b * other[index] + along * value);
  });
}

export const clamp = (value, low, high) => Math.min(high, Math.max(low, value));
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

function normalised(vector) {
  const length = Math.hypot(...vector);
  return vector.map((value) => value / length);
}

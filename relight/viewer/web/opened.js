// Environment maps and backgrounds that a page has opened: a viewer's state names them by number.

import { readImage } from "./environment.js";
import { LUMINANCE, dot } from "./lights.js";
import { fromBase64 } from "./pack.js";

/** An environment's lamps, as Python writes them: a direction and a power in a row. */
export const lampsOfRows = (rows) => rows.map((row) => ({ toward: row.slice(0, 3), power: row.slice(3) }));

/**
 * An environment map: its lamps, scaled so that half floats hold their sum; `id`: what an application knows its file
 * by.
 */
export function mapOf(path, lamps, id = null) {
  const strength = lamps.reduce((sum, lamp) => sum + dot(LUMINANCE, lamp.power), 0) || 1;
  return {
    path,
    id,
    strength,
    lamps: lamps.map((lamp) => ({ ...lamp, power: lamp.power.map((value) => value / strength) })),
  };
}

/**
 * A background as Python writes it: { name, data: base64, lamps: its light around the person, or null }, and the id
 * that an application knows its file by.
 */
export async function backdropOf({ name, data, lamps = null, file = null }) {
  const light = lamps && mapOf(name, lampsOfRows(lamps));
  return { ...(await readImage(new File([fromBase64(data)], "background.jpg"))), name, light, id: file };
}

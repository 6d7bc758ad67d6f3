// Environment maps: a .hdr file or a picture, and the directional lights that it comes down to.
// Latitude-longitude, as relight.EnvironmentLight: the centre is at the camera, the left half at image right.

import { decoded } from "./colour.js";
import { DEGREE } from "./lights.js";

const LAMPS = 256; // directions at most
const GRID_ROWS = 256; // of the grid that is divided among the lamps
const FEWEST_ROWS = 64; // coarser maps are repeated to it

/** A file that cannot be used, and why, for whoever dropped it. */
export class Refused extends Error {}

/** An image file as { name, width, height, rgb: Float32Array, linear }, three values a pixel. */
export async function readImage(file) {
  if (/\.exr$/i.test(file.name)) {
    throw new Refused(`${file.name}: OpenEXR files cannot be opened here. Save it as .hdr, or as a PNG.`);
  }
  if (/\.(hdr|rgbe|pic)$/i.test(file.name)) return radiance(file.name, new Uint8Array(await file.arrayBuffer()));
  let bitmap;
  try {
    bitmap = await createImageBitmap(file);
  } catch {
    throw new Refused(`${file.name}: is no picture that this browser can open.`);
  }
  const shrink = Math.min(1, 4096 / Math.max(bitmap.width, bitmap.height));
  const canvas = document.createElement("canvas");
  canvas.width = Math.max(1, Math.round(bitmap.width * shrink));
  canvas.height = Math.max(1, Math.round(bitmap.height * shrink));
  const context = canvas.getContext("2d");
  context.drawImage(bitmap, 0, 0, canvas.width, canvas.height);
  const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
  const rgb = new Float32Array(canvas.width * canvas.height * 3);
  const table = Float32Array.from({ length: 256 }, (_, code) => decoded(code / 255));
  for (let pixel = 0; pixel < rgb.length / 3; pixel++) {
    for (let channel = 0; channel < 3; channel++) rgb[pixel * 3 + channel] = table[data[pixel * 4 + channel]];
  }
  return { name: file.name, width: canvas.width, height: canvas.height, rgb };
}

/** Radiance's RGBE (Ward 1991), run-length encoded or not. */
export function radiance(name, bytes) {
  const text = new TextDecoder("latin1").decode(bytes.subarray(0, 65536));
  const header = /^#\?[^]*?\n\s*\n-Y (\d+) \+X (\d+)\n/.exec(text);
  if (!header) throw new Refused(`${name}: is no Radiance picture with its top row first.`);
  const [height, width] = [Number(header[1]), Number(header[2])];
  if (width * height > 1 << 26) throw new Refused(`${name}: has more than 64 million pixels.`);
  const rgb = new Float32Array(width * height * 3);
  const row = new Uint8Array(width * 4);
  let at = header[0].length;
  for (let y = 0; y < height; y++) {
    at = scanline(bytes, at, width, row);
    if (at > bytes.length) throw new Refused(`${name}: ends before its last row.`);
    for (let x = 0; x < width; x++) {
      const scale = row[x + 3 * width] ? 2 ** (row[x + 3 * width] - 136) : 0;
      for (let channel = 0; channel < 3; channel++) {
        rgb[(y * width + x) * 3 + channel] = row[x + channel * width] * scale;
      }
    }
  }
  return { name, width, height, rgb };
}

/** One row into planes of red, green, blue and exponent; where the next one begins. */
function scanline(bytes, at, width, row) {
  const packed = bytes[at] === 2 && bytes[at + 1] === 2 && bytes[at + 2] * 256 + bytes[at + 3] === width;
  if (!packed) {
    for (let x = 0; x < width; x++) for (let k = 0; k < 4; k++) row[x + k * width] = bytes[at + x * 4 + k];
    return at + width * 4;
  }
  at += 4;
  for (let place = 0; place < row.length && at < bytes.length;) {
    const count = bytes[at++];
    if (count > 128) row.fill(bytes[at++], place, (place += count - 128));
    else for (let k = 0; k < count; k++) row[place++] = bytes[at++];
  }
  return at;
}

/** The map's lamps, [{ toward, power: [r, g, b] }], most where the light is: relight/lights/environment.py. */
export function lampsOf({ name, width, height, rgb }) {
  if (width !== 2 * height) {
    throw new Refused(`${name}: is ${width} × ${height} pixels; an environment is twice as wide as high.`);
  }
  return divide(cells(rgb, height)).map(([red, green, blue, , x, y, z]) => {
    const length = Math.hypot(x, y, z);
    const toward = length ? [x / length, y / length, z / length] : [0, 0, 1];
    return { toward, power: [red / Math.PI, green / Math.PI, blue / Math.PI] };
  });
}

/** Lamps turned about the vertical, from the camera toward image right. */
export function turned(lamps, degrees) {
  const [sine, cosine] = [Math.sin(degrees * DEGREE), Math.cos(degrees * DEGREE)];
  return lamps.map(({ toward: [x, y, z], power }) => ({
    toward: [x * cosine + z * sine, y, z * cosine - x * sine],
    power,
  }));
}

/** Light sums over a grid of cells: radiance × solid angle, its mean, and that times the direction. */
function cells(rgb, rowsOfMap) {
  const repeat = Math.ceil(FEWEST_ROWS / rowsOfMap);
  const height = rowsOfMap * repeat;
  const width = 2 * height;
  const [rows, columns] = [Math.min(GRID_ROWS, height), Math.min(2 * GRID_ROWS, width)];
  const sums = Array.from({ length: rows }, () => new Float64Array(columns * 7));
  const starts = (count, whole) => Array.from({ length: count + 1 }, (_, k) => Math.floor((k * whole) / count));
  const cellOf = (edges) => edges.slice(0, -1).flatMap((from, cell) => Array(edges[cell + 1] - from).fill(cell));
  const [rowCell, columnCell] = [cellOf(starts(rows, height)), cellOf(starts(columns, width))];
  for (let y = 0; y < height; y++) {
    const [top, bottom] = [y, y + 1].map((edge) => Math.PI / 2 - (edge * Math.PI) / height);
    const solidAngle = ((Math.sin(top) - Math.sin(bottom)) * 2 * Math.PI) / width;
    const middle = (top + bottom) / 2;
    const cell = sums[rowCell[y]];
    for (let x = 0; x < width; x++) {
      const around = Math.PI - ((x + 0.5) * 2 * Math.PI) / width;
      const source = (Math.floor(y / repeat) * (width / repeat) + Math.floor(x / repeat)) * 3;
      const place = columnCell[x] * 7;
      let mean = 0;
      for (let channel = 0; channel < 3; channel++) {
        const light = rgb[source + channel] * solidAngle;
        cell[place + channel] += light;
        mean += light / 3;
      }
      mean = Math.max(mean, 0);
      cell[place + 3] += mean;
      cell[place + 4] += mean * Math.sin(around) * Math.cos(middle);
      cell[place + 5] += mean * Math.sin(middle);
      cell[place + 6] += mean * Math.cos(around) * Math.cos(middle);
    }
  }
  return sums;
}

/** Variance minimisation light probe sampling (Viriyothai and Debevec 2009), as Python's `_divide`. */
function divide(sums) {
  const [rows, columns] = [sums.length, sums[0].length / 7];
  const stride = (columns + 1) * 7;
  const table = new Float64Array((rows + 1) * stride); // sums of all cells above and to the left
  for (let y = 0; y < rows; y++) {
    for (let x = 0; x < columns; x++) {
      for (let k = 0; k < 7; k++) {
        const at = (y + 1) * stride + (x + 1) * 7 + k;
        table[at] = sums[y][x * 7 + k] + table[at - stride] + table[at - 7] - table[at - stride - 7];
      }
    }
  }
  const part = (top, bottom, left, right, k) =>
    table[bottom * stride + right * 7 + k] -
    table[top * stride + right * 7 + k] -
    table[bottom * stride + left * 7 + k] +
    table[top * stride + left * 7 + k];
  const loss = (...region) =>
    part(...region, 3) - Math.hypot(part(...region, 4), part(...region, 5), part(...region, 6));
  const entry = (region) => {
    const [top, bottom, left, right] = region;
    return { region, loss: bottom - top === 1 && right - left === 1 ? 0 : loss(...region) };
  };
  const regions = [entry([0, rows, 0, columns])];
  const least = 1e-9 * part(0, rows, 0, columns, 3);
  while (regions.length < LAMPS) {
    const worst = regions.reduce((best, { loss }, index) => (loss > regions[best].loss ? index : best), 0);
    if (regions[worst].loss <= least) break;
    regions.splice(worst, 1, ...cut(regions[worst].region, loss).map(entry));
  }
  return regions.map(({ region }) => [0, 1, 2, 3, 4, 5, 6].map((k) => part(...region, k)));
}

/** The two parts of a region whose losses add up to the least. */
function cut([top, bottom, left, right], loss) {
  let best = { loss: Infinity };
  const consider = (first, second) => {
    const sum = loss(...first) + loss(...second);
    if (sum < best.loss) best = { loss: sum, parts: [first, second] };
  };
  for (let row = top + 1; row < bottom; row++) consider([top, row, left, right], [row, bottom, left, right]);
  for (let column = left + 1; column < right; column++) {
    consider([top, bottom, left, column], [top, bottom, column, right]);
  }
  return best.parts;
}

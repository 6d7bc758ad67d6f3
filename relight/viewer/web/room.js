// Where the person is in the room, and lamps that stand there: see relight/analysis/depth.py and
// relight/lights/near.py.
// Positions are metres in the camera's axes, from the subject's middle.

import { DEGREE, angles, clamp, direction, isNear, softness } from "./lights.js";

const NEAREST = 0.05; // of the camera's distance: lamps closer to the camera are shown as if there
const THICK = 1.5; // how deep a limb surely is, over the distance to its rim: relight/analysis/maps.py
const ASIDE = 0.5; // of the person's height: where a distant light comes to stand

export class Room {
  constructor({ description, arrays }) {
    const { camera, canvas, box, size } = description;
    this.camera = camera;
    this.canvas = canvas;
    this.perPixel = camera.size[0] / size[0]; // plate pixels that a pixel of the page stands for
    this.height = (box[3] * this.perPixel * camera.distance) / camera.focal; // about the person's, metres
    this.middle = this.slopes(camera.middle);
    this.depth = Float32Array.from(arrays.depth.data, fromHalf);
    const pixels = canvas[0] * canvas[1];
    this.known = arrays.guide.data.subarray(3 * pixels);
    this.positions = this.ofCanvas();
  }

  slopes([x, y]) {
    const { size, focal } = this.camera;
    return [(x - size[0] / 2) / focal, (y - size[1] / 2) / focal];
  }

  /** Four values a canvas pixel: its position, and one. */
  ofCanvas() {
    const { camera, canvas, depth } = this;
    const positions = new Float32Array(depth.length * 4);
    for (let pixel = 0; pixel < depth.length; pixel++) {
      const across = ((pixel % canvas[0]) + 0.5 - canvas[0] / 2) / camera.scale + camera.centre[0];
      const down = (Math.floor(pixel / canvas[0]) + 0.5 - canvas[1] / 2) / camera.scale + camera.centre[1];
      positions.set([...this.at([across, down], -depth[pixel]), 1], pixel * 4);
    }
    return positions;
  }

  /** The position that a place on the plate shows at a z. */
  at(place, z) {
    const { distance } = this.camera;
    const [across, down] = this.slopes(place);
    const away = distance - z;
    return [across * away - this.middle[0] * distance, this.middle[1] * distance - down * away, z];
  }

  /** Where on the plate a position is seen. */
  onPlate([x, y, z]) {
    const { distance, focal, size } = this.camera;
    const away = Math.max(distance - z, NEAREST * distance);
    return [
      ((x + this.middle[0] * distance) / away) * focal + size[0] / 2,
      ((this.middle[1] * distance - y) / away) * focal + size[1] / 2,
    ];
  }

  /** The largest z of a lamp: just before the camera. */
  get nearest() {
    return (1 - NEAREST) * this.camera.distance;
  }

  /** Where on the page's picture a position is seen, in the picture's pixels. */
  onPicture(position) {
    return this.onPlate(position).map((value) => value / this.perPixel);
  }

  /** The position that a pixel of the page's picture shows at a z, or at the largest z of a lamp. */
  seenAt(place, z) {
    return this.at(
      place.map((value) => value * this.perPixel),
      Math.min(z, this.nearest),
    );
  }

  /** A position moved along the camera's ray through it, so that it is seen where it was. */
  pushed(position, metres) {
    const { distance } = this.camera;
    const z = clamp(position[2] - metres, -20 * distance, this.nearest);
    return this.at(this.onPlate(position), z);
  }

  /** A position brought `times` nearer to the camera along that ray. */
  drawn(position, times) {
    const away = this.camera.distance - position[2];
    return this.pushed(position, away / times - away);
  }

  /** Why no lamp can stand there, or null: `check_outside` of relight/analysis/maps.py. */
  obstacle({ position, radius }) {
    const { canvas, camera, known, positions } = this;
    const [x, y, z] = position;
    let gap = Infinity;
    for (let pixel = 0; pixel < known.length; pixel++) {
      if (!known[pixel]) continue;
      const at = pixel * 4;
      gap = Math.min(gap, (positions[at] - x) ** 2 + (positions[at + 1] - y) ** 2 + (positions[at + 2] - z) ** 2);
    }
    if (Math.sqrt(gap) <= Math.max(radius, camera.metresPerPixel / 2)) return "touches the person";
    const place = this.onPlate(position).map((value, axis) =>
      Math.floor((value - camera.centre[axis]) * camera.scale + canvas[axis] / 2),
    );
    const inside = z < camera.distance && place.every((value, axis) => value >= 0 && value < canvas[axis]);
    const pixel = place[1] * canvas[0] + place[0];
    if (!inside || !known[pixel]) return null;
    const behind = -z - this.depth[pixel];
    return behind > 0 && behind < THICK * this.rim(place) * camera.metresPerPixel ? "is inside the person" : null;
  }

  /**
   * Canvas pixels from a place on the person to the nearest beside them.
   * @param {number[]} place
   */
  rim([column, row]) {
    const { canvas, known } = this;
    let least = Infinity;
    for (let pixel = 0; pixel < known.length; pixel++) {
      if (known[pixel]) continue;
      least = Math.min(least, ((pixel % canvas[0]) - column) ** 2 + (Math.floor(pixel / canvas[0]) - row) ** 2);
    }
    return Math.sqrt(least);
  }

  /** A distant light as a lamp that lights the person about as much, or the other way round. */
  switched(light) {
    const { azimuth, elevation, angle, position, radius, ...shared } = light;
    if (isNear(light)) {
      const metres = Math.max(Math.hypot(...position), 1e-3);
      return {
        ...shared,
        exposure: rounded(clamp(shared.exposure - 2 * Math.log2(metres), -64, 64)),
        ...angles(position),
        angle: rounded(softness(light)),
      };
    }
    const metres = ASIDE * this.height;
    return {
      ...shared,
      exposure: rounded(clamp(shared.exposure + 2 * Math.log2(metres), -64, 64)),
      position: direction(light).map((part) => rounded(part * metres)),
      radius: rounded(metres * Math.min(Math.sin((Math.min(angle, 180) / 2) * DEGREE), 0.5)),
    };
  }
}

const rounded = (value) => Number(value.toFixed(3));

/** The value of a half float's sixteen bits. */
export function fromHalf(bits) {
  const [sign, exponent, fraction] = [bits & 0x8000 ? -1 : 1, (bits >> 10) & 31, bits & 1023];
  return sign * (exponent ? 2 ** (exponent - 15) * (1 + fraction / 1024) : 2 ** -14 * (fraction / 1024));
}

// The picture drawn smaller, by an engine of its own: while one drags where WebGL is slow, and for small pictures.

import { Engine } from "./engine.js";

const EVERY = 4; // of the directions of a soft light, one in so many is drawn in a small picture
const EVERY_OF_DRAFT = 16; // the same while one drags
const STRIDE = 2; // of the networks' canvas, one pixel in so many across and down
const DRAFT_SIDE = 320; // pixels of the longer side

/** A picture of the whole state at a lower resolution, on a canvas that lies over the stage's. */
export class Draft {
  static async of(viewer) {
    const { size } = viewer.pack.description;
    const pack = await reducedPack(viewer.pack, Math.min(1, DRAFT_SIDE / Math.max(...size)));
    const canvas = viewer.stage.overlay();
    return new Draft(new Engine(canvas, strided(pack), stridedRoom(viewer.room, pack), SHADERS));
  }

  constructor(engine) {
    this.engine = engine;
    this.shown = false; // over the picture
    this.known = new WeakMap(); // from samples to those of them that are drawn
  }

  /** Fewer samples; the same object for the same samples, which an engine draws once. */
  fewer(samples) {
    if (!this.known.has(samples)) this.known.set(samples, fewer(samples, EVERY_OF_DRAFT));
    return this.known.get(samples);
  }

  /** Draws what the viewer shows. */
  draw(viewer) {
    const { engine } = this;
    const { state } = viewer;
    if (engine.backdrop !== viewer.backdrop) engine.setBackground(viewer.backdrop);
    if (engine.floorShadow !== viewer.engine.floorShadow) engine.setFloorShadow(viewer.engine.floorShadow);
    const layers = viewer.layersOf(state).map((layer) => layer && { ...layer, samples: this.fewer(layer.samples) });
    engine.setLights(layers, state.gloss, state.amount);
    viewer.showOn(engine);
  }
}

/**
 * A pack whose picture is `shrink` times as large; `cropped`: to the person's part.
 * @param {any} pack
 * @param {number} shrink
 */
export async function reducedPack(pack, shrink, cropped = false) {
  const { description: about, arrays, images } = pack;
  const smaller = (side) => Math.max(1, Math.round(side * shrink));
  const [left, top, width, height] = about.box;
  const size = [width, height].map(smaller);
  const reduced = (image) =>
    createImageBitmap(image, {
      resizeWidth: size[0],
      resizeHeight: size[1],
      resizeQuality: "high",
      premultiplyAlpha: "none",
      colorSpaceConversion: "none",
    });
  const [photograph, albedo] = await Promise.all([images.photograph, images.albedo].map(reduced));
  const matte = { shape: [1, size[1], size[0]], data: averaged(arrays.matte.data, [width, height], size) };
  const description = {
    ...about,
    size: cropped ? size : about.size.map(smaller),
    box: [...(cropped ? [0, 0] : [left, top].map((place) => Math.round(place * shrink))), ...size],
    centre: about.centre.map((place) => place * shrink),
    scale: about.scale / shrink,
  };
  return { description, arrays: { ...arrays, matte }, images: { photograph, albedo } };
}

/** Some of a distant light's samples in place of all, with their power; a near light as it is. */
export function fewer(all, every = EVERY) {
  if (!Array.isArray(all)) return all;
  // from the middle of each so many
  const some = all.length < every ? all : all.filter((_, index) => index % every === every / 2);
  const times = all.length / some.length;
  return some.map(({ toward, power }) => ({ toward, power: power.map((value) => value * times) }));
}

/** A pack with one pixel in so many of the networks' canvas. */
export function strided(pack) {
  const { description, arrays } = pack;
  const onCanvas = ["features", "surface", "rim", "guide"];
  const thinned = Object.fromEntries(onCanvas.map((name) => [name, everySo(arrays[name])]));
  return {
    ...pack,
    arrays: { ...arrays, ...thinned },
    description: {
      ...description,
      canvas: description.canvas.map((side) => Math.floor(side / STRIDE)),
      scale: description.scale / STRIDE,
    },
  };
}

/** The positions of a room on that canvas; `pack`: before it was strided. */
export function stridedRoom(room, { description }) {
  const [width, height] = description.canvas;
  const positions = new Float32Array(Math.floor(width / STRIDE) * Math.floor(height / STRIDE) * 4);
  let at = 0;
  for (let row = 0; row + STRIDE <= height; row += STRIDE)
    for (let column = 0; column + STRIDE <= width; column += STRIDE, at += 4) {
      const from = (row * width + column) * 4;
      positions.set(room.positions.subarray(from, from + 4), at);
    }
  return { positions };
}

/** Planes (n, h, w) with one pixel in so many across and down. */
function everySo({ data, shape }) {
  const [planes, height, width] = shape;
  const sides = [Math.floor(height / STRIDE), Math.floor(width / STRIDE)];
  const found = new data.constructor(planes * sides[0] * sides[1]);
  let at = 0;
  for (let plane = 0; plane < planes; plane++)
    for (let row = 0; row < sides[0]; row++)
      for (let column = 0; column < sides[1]; column++)
        found[at++] = data[(plane * height + row * STRIDE) * width + column * STRIDE];
  return { data: found, shape: [planes, ...sides] };
}

/**
 * Grey pixels (0 to 255) of one size, averaged to a smaller one.
 * @param {Uint8Array} data
 * @param {number[]} from
 * @param {number[]} to
 */
function averaged(data, [width, height], [across, down]) {
  const found = new Uint8Array(across * down);
  for (let y = 0; y < down; y++) {
    const [top, bottom] = [y, y + 1].map((row) => Math.floor((row * height) / down));
    for (let x = 0; x < across; x++) {
      const [left, right] = [x, x + 1].map((column) => Math.floor((column * width) / across));
      let sum = 0;
      for (let row = top; row < bottom; row++)
        for (let column = left; column < right; column++) sum += data[row * width + column];
      found[y * across + x] = sum / Math.max(1, (bottom - top) * (right - left));
    }
  }
  return found;
}

// Small pictures of the person in other lights, drawn by an engine of its own on a reduced copy of the pack.

import { Engine, SHADERS, power, samples } from "../viewer.js";
import { lightsOf } from "./presets.js";

export const THUMB = [128, 128]; // pixels
const TALLEST = 1.15; // of the person's part that is shown, over its width: head and trunk of a whole person
const LAYERS = 9; // of an engine: eight lights, and an environment
const EVERY = 4; // of the directions of a soft light, one in so many is drawn

export class Thumbs {
  static async of(viewer) {
    const { pack } = viewer;
    const { description: about, arrays, images } = pack;
    const [, , width, height] = about.box;
    const tall = Math.min(height, TALLEST * width);
    const shrink = Math.min(1, Math.max(THUMB[0] / width, THUMB[1] / tall));
    const size = [width, height].map((side) => Math.max(1, Math.round(side * shrink)));
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
      size,
      box: [0, 0, ...size],
      centre: about.centre.map((place) => place * shrink),
      scale: about.scale / shrink,
    };
    const small = { description, arrays: { ...arrays, matte }, images: { photograph, albedo } };
    return new Thumbs(
      new Engine(document.createElement("canvas"), small, viewer.room, SHADERS),
      viewer.tints,
      Math.round(tall * shrink),
    );
  }

  constructor(engine, tints, tall) {
    this.engine = engine;
    this.tints = tints;
    this.tall = tall;
  }

  /** Draws the person in the light of a preset on a canvas; `gain`: of its lights. */
  draw(canvas, preset, gain) {
    const { engine } = this;
    const given = lightsOf(preset, gain);
    engine.setLights(
      Array.from({ length: LAYERS }, (_, slot) =>
        given[slot] ? { samples: fewer(samples(given[slot])), colour: power(given[slot], this.tints) } : null,
      ),
      preset.gloss,
    );
    engine.show("picture", { exposure: 0, background: null });
    const [width] = engine.size;
    const fit = Math.min(canvas.width / width, canvas.height / this.tall);
    const context = canvas.getContext("2d");
    context.imageSmoothingQuality = "high";
    context.drawImage(
      engine.canvas,
      0,
      0,
      width,
      this.tall,
      (canvas.width - width * fit) / 2,
      canvas.height - this.tall * fit,
      width * fit,
      this.tall * fit,
    );
  }

  /** Resolves when the graphics processor has drawn: the light in the hand then waits for one thumbnail at most. */
  async drawn() {
    const { gl } = this.engine;
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    while (gl.getSyncParameter(fence, gl.SYNC_STATUS) === gl.UNSIGNALED)
      await new Promise((done) => setTimeout(done, 10));
    gl.deleteSync(fence);
  }

  close() {
    this.engine.close();
  }
}

/** Some of a distant light's samples in place of all, with their power; a near light as it is. */
function fewer(all) {
  if (!Array.isArray(all)) return all;
  // from the middle of each four
  const some = all.length < EVERY ? all : all.filter((_, index) => index % EVERY === EVERY / 2);
  const times = all.length / some.length;
  return some.map(({ toward, power }) => ({ toward, power: power.map((value) => value * times) }));
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

// Small pictures of the person in other lights, drawn by an engine of its own on a reduced copy of the pack.

import { Engine, SHADERS, fewer, power, reducedPack, samples, strided, stridedRoom } from "../viewer.js";
import { lightsOf } from "./presets.js";

export const THUMB = [128, 128]; // pixels
const TALLEST = 1.15; // of the person's part that is shown, over its width: head and trunk of a whole person
const LAYERS = 9; // of an engine: eight lights, and an environment

export class Thumbs {
  static async of(viewer) {
    const { pack } = viewer;
    const [, , width, height] = pack.description.box;
    const tall = Math.min(height, TALLEST * width);
    const shrink = Math.min(1, Math.max(THUMB[0] / width, THUMB[1] / tall));
    const small = await reducedPack(pack, shrink, true);
    return new Thumbs(
      new Engine(document.createElement("canvas"), strided(small), stridedRoom(viewer.room, small), SHADERS),
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
    drawThumb(canvas, engine.canvas, engine.size[0], this.tall);
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

/** Draws the upper part of a picture of a person at the bottom of a thumbnail's canvas. */
export function drawThumb(canvas, picture, width = picture.width, tall = picture.height) {
  const fit = Math.min(canvas.width / width, canvas.height / tall);
  const context = canvas.getContext("2d");
  context.imageSmoothingQuality = "high";
  const [across, down] = [width * fit, tall * fit];
  context.drawImage(picture, 0, 0, width, tall, (canvas.width - across) / 2, canvas.height - down, across, down);
}

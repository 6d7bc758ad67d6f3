// The person's shadow on the floor, which the server makes a moment after each change of the light.

import { readImage } from "../viewer.js";
import { Refused, post } from "./requests.js";

const PAUSE = 120; // milliseconds after a change before a shadow is asked for

export class FloorShadow {
  /** `look()`: what the server makes the shadow of; `fail(error)`: says what went wrong. */
  constructor(viewer, photograph, look, fail) {
    this.viewer = viewer;
    this.photograph = photograph;
    this.look = look;
    this.fail = fail;
    this.wanted = null;
    viewer.listeners.add(() => this.follow());
  }

  follow() {
    // The shadow is the same before any background, and for any gloss and exposure.
    const look = { ...this.look(), background: null, exposure: 0, gloss: 0 };
    const wanted = look.floor && (look.lights.length || look.environment) ? JSON.stringify(look) : null;
    if (wanted === this.wanted) return;
    this.wanted = wanted;
    clearTimeout(this.waiting);
    if (wanted) this.waiting = setTimeout(() => this.ask(), PAUSE);
    else this.show(null);
  }

  show(picture) {
    this.viewer.engine.setFloorShadow(picture);
    this.viewer.drawSoon();
  }

  /** Asks for the shadow; while one is made, only the last state waits. */
  async ask() {
    if (this.asking) return;
    this.asking = true;
    try {
      for (let asked = null; this.wanted && asked !== this.wanted;) {
        asked = this.wanted;
        const response = await post(`photographs/${this.photograph.id}/floor`, JSON.parse(asked));
        const picture = await readImage(new File([await response.blob()], "shadow.png"));
        if (this.wanted) this.show(picture);
      }
    } catch (error) {
      if (error instanceof Refused) this.viewer.change((state) => (state.floor = null));
      this.fail(error);
    } finally {
      this.asking = false;
    }
  }
}

// The person's shadow on the floor, which the server makes a moment after each change of the light.

import { readImage } from "../viewer.js";
import { Latest } from "./latest.js";
import { Refused, post } from "./requests.js";

const PAUSE = 120; // milliseconds after a change before a shadow is asked for

export class FloorShadow {
  /** `look()`: what the server makes the shadow of; `fail(error)`: says what went wrong. */
  constructor(viewer, photograph, look, fail) {
    this.viewer = viewer;
    this.look = look;
    const make = async (text) => {
      const response = await post(`photographs/${photograph.id}/floor`, JSON.parse(text));
      const picture = await readImage(new File([await response.blob()], "shadow.png"));
      if (this.latest.wanted) this.show(picture);
    };
    this.latest = new Latest(PAUSE, make, (error) => {
      if (error instanceof Refused) viewer.change((state) => (state.floor = null));
      fail(error);
    });
    viewer.listeners.add(() => this.follow());
  }

  follow() {
    // The shadow is the same before any background, and for any gloss and exposure.
    const look = { ...this.look(), background: null, exposure: 0, gloss: 0, amount: 1 };
    const wanted = look.floor && (look.lights.length || look.environment) ? JSON.stringify(look) : null;
    if (wanted === null && this.latest.wanted !== null) this.show(null);
    this.latest.want(wanted);
  }

  show(picture) {
    this.viewer.engine.setFloorShadow(picture);
    this.viewer.drawSoon();
  }
}

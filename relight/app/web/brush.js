// The brush of light, for which the server solves while one paints.

import { Brush } from "../viewer.js";
import { Latest } from "./latest.js";
import { Refused, post } from "./requests.js";

const PAUSE = 40; // milliseconds after a stroke grows before its lights are asked for

export class ServerBrush extends Brush {
  /** `look(viewer)`: the light as the server takes it; `fail(error)`: says what went wrong. */
  constructor(look, fail) {
    super();
    this.look = look;
    this.latest = new Latest(
      PAUSE,
      (text) => this.solve(text),
      (error) => (error instanceof Refused ? this.say(error.message) : fail(error)),
    );
  }

  attach(viewer, photograph) {
    super.attach(viewer);
    this.photograph = photograph;
  }

  begin() {
    this.base = this.look(this.viewer);
  }

  want() {
    this.latest.want(JSON.stringify({ look: this.base, strokes: this.strokes }));
  }

  async solve(text) {
    const response = await post(`photographs/${this.photograph.id}/paint`, JSON.parse(text));
    const answer = await response.json();
    if (this.latest.wanted) this.take(answer);
  }

  quit() {
    this.latest.close();
  }
}

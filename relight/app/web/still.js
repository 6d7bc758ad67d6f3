// The picture where the browser has no WebGL 2: the server makes it of each state, a moment later.
// It stands in for the viewer's Engine, so that handles, panel, keys and presets work as they do with it.

import { Latest } from "./latest.js";
import { post, previewOf } from "./requests.js";

const PAUSE = 80; // milliseconds after a change before a picture is asked for

export class StillEngine {
  /** `look()`: what the server makes the picture of; `fail(error)`: says what went wrong. */
  constructor(viewer, photograph, look, fail) {
    this.viewer = viewer;
    this.look = look;
    this.first = new Promise((come) => (this.come = come)); // resolves when the first picture has come
    const make = async (text) => {
      viewer.root.classList.add("waiting");
      try {
        const response = await post(`photographs/${photograph.id}/still`, JSON.parse(text));
        this.picture = await createImageBitmap(await response.blob());
        viewer.drawSoon();
      } finally {
        this.come();
        viewer.root.classList.remove("waiting");
      }
    };
    this.latest = new Latest(PAUSE, make, fail);
    this.canvas = viewer.stage.replaceCanvas(); // one that was tried with WebGL 2 gives no other context
    [this.canvas.width, this.canvas.height] = viewer.pack.description.size;
    this.looks = ["picture", "photograph"];
    this.lost = false;
    this.backdrop = null;
    this.picture = null; // the last one that came
    this.original = new Image();
    this.original.src = previewOf(photograph);
    this.original.decode().then(() => this.viewer.drawSoon(), fail);
  }

  setLights() {}

  setFloorShadow() {} // it is in the server's pictures

  setBackground(picture) {
    this.backdrop = picture;
  }

  /** Shows the last picture, or the photograph, and asks for the picture of the state where that is another. */
  show(look, { part = [0, 1] }) {
    const { width, height } = this.canvas;
    const context = this.canvas.getContext("2d");
    const left = Math.round(part[0] * width);
    const across = Math.round(part[1] * width) - left;
    const image = look === "photograph" ? this.original : this.picture;
    context.save();
    context.beginPath();
    context.rect(left, 0, across, height);
    context.clip();
    context.clearRect(left, 0, across, height);
    if (image) context.drawImage(image, 0, 0, width, height);
    context.restore();
    if (look !== "photograph") this.latest.want(JSON.stringify(this.look()));
  }

  /** What is shown, as {width, height, data}: encoded RGBA bytes with straight alpha, top row first. */
  readShown() {
    const { width, height } = this.canvas;
    return { width, height, data: this.canvas.getContext("2d").getImageData(0, 0, width, height).data };
  }

  /** Ends what is on its way. */
  close() {
    this.latest.close();
  }
}

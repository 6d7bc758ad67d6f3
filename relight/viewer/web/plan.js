// The room from above and from the side: depth is the one axis that the picture does not show.

import { chroma, toHex } from "./colour.js";
import { h } from "./dom.js";
import { clamp, direction, isNear, power } from "./lights.js";
import { shining } from "./state.js";

const SIDE = 280; // canvas pixels, of a square that is about half as many CSS pixels
const NEAREST_EXTENT = 0.75; // half the side in the person's heights; it doubles until all lamps fit
const GRAB = 28; // canvas pixels from a lamp within which a press selects it
const EDGE = 14; // canvas pixels from the edge, where a lamp beyond it is shown

// [name, axis to the right with its sign, axis upward with its sign, where the camera is]
const VIEWS = [
  ["From above", [0, 1], [2, -1], [0, 1]],
  ["From the side", [2, 1], [1, 1], [1, 0]],
];

export class Plan {
  constructor(viewer) {
    this.viewer = viewer;
    /** @type {any[]} */
    this.views = VIEWS.map(([name, ...axes]) => {
      const canvas = h("canvas", { width: SIDE, height: SIDE, "aria-hidden": "true", title: `${name}: drag the lamp` });
      this.listen(canvas, axes);
      return { canvas, axes, element: h("figure", {}, canvas, h("figcaption", {}, name)) };
    });
    this.element = h("div", { class: "plan" }, ...this.views.map(({ element }) => element));
    this.extent = 0; // metres from the middle to an edge
  }

  /** Canvas pixels of a position. */
  spot(position, [[right, toRight], [up, toUp]]) {
    const scale = SIDE / 2 / this.extent;
    return [SIDE / 2 + toRight * position[right] * scale, SIDE / 2 - toUp * position[up] * scale];
  }

  listen(canvas, axes) {
    const { viewer } = this;
    const place = (event) => {
      const bounds = canvas.getBoundingClientRect();
      return [(event.clientX - bounds.left) / bounds.width, (event.clientY - bounds.top) / bounds.height].map(
        (share) => share * SIDE,
      );
    };
    const move = (event) => {
      if (!canvas.hasPointerCapture(event.pointerId)) return;
      const [x, y] = place(event);
      const [[right, toRight], [up, toUp]] = axes;
      const metres = (pixels) => Number(((pixels / (SIDE / 2) - 1) * this.extent).toFixed(3));
      viewer.change((state) => {
        const { position } = state.lights[state.selected];
        position[right] = toRight * metres(x);
        position[up] = -toUp * metres(y);
        position[2] = Math.min(position[2], viewer.room.nearest);
      }, "plan");
    };
    canvas.addEventListener("pointerdown", (event) => {
      viewer.stop();
      const { lights } = viewer.state;
      const [x, y] = place(event);
      const away = lights.map((light) => {
        if (!isNear(light)) return Infinity;
        const [across, down] = this.shownAt(light.position, axes);
        return Math.hypot(across - x, down - y);
      });
      const nearest = away.indexOf(Math.min(...away));
      if (away[nearest] < GRAB) viewer.select(nearest);
      if (!isNear(viewer.state.lights[viewer.state.selected])) return;
      canvas.setPointerCapture(event.pointerId);
      this.held = true;
      move(event);
    });
    canvas.addEventListener("pointermove", move);
    for (const name of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(name, () => {
        this.held = false;
        viewer.endGesture();
        viewer.refresh(); // the extent follows the lamps once they are let go
      });
    }
  }

  shownAt(position, axes) {
    return this.spot(position, axes).map((value) => clamp(value, EDGE, SIDE - EDGE));
  }

  /** Shows a state. */
  update(state) {
    if (!this.held) this.fit(state.lights.filter(isNear));
    const active = new Set(shining(state));
    for (const { canvas, axes, person } of this.views) {
      const context = canvas.getContext("2d");
      context.clearRect(0, 0, SIDE, SIDE);
      this.drawRoom(context, axes);
      context.drawImage(person, 0, 0);
      state.lights.forEach((light, index) =>
        this.drawLight(context, axes, light, active.has(light), index === state.selected),
      );
    }
  }

  /** Chooses the extent that shows all lamps, and draws the person at it. */
  fit(lamps) {
    const { height } = this.viewer.room;
    const farthest = Math.max(0, ...lamps.flatMap(({ position }) => position.map(Math.abs)));
    let extent = NEAREST_EXTENT * height;
    while (extent < 1.1 * farthest && extent < 100 * height) extent *= 2;
    if (extent === this.extent) return;
    this.extent = extent;
    for (const view of this.views) view.person = this.person(view.axes);
  }

  /** The person's visible surface, a dot for each pixel of the networks' canvas. */
  person(axes) {
    const { known, positions } = this.viewer.room;
    const canvas = h("canvas", { width: SIDE, height: SIDE });
    const context = canvas.getContext("2d");
    const image = context.createImageData(SIDE, SIDE);
    for (let pixel = 0; pixel < known.length; pixel++) {
      if (!known[pixel]) continue;
      const [x, y] = this.spot(positions.subarray(pixel * 4, pixel * 4 + 3), axes).map(Math.floor);
      for (const [across, down] of [
        [0, 0],
        [1, 0],
        [0, 1],
        [1, 1],
      ]) {
        if (x + across < 0 || y + down < 0 || x + across >= SIDE || y + down >= SIDE) continue;
        const at = ((y + down) * SIDE + x + across) * 4;
        image.data.set([190, 190, 190, Math.min(255, image.data[at + 3] + 70)], at);
      }
    }
    context.putImageData(image, 0, 0);
    return canvas;
  }

  drawRoom(context, [, , camera]) {
    context.strokeStyle = "rgb(255 255 255 / 16%)";
    context.lineWidth = 1.5;
    const metre = SIDE / 2 / this.extent;
    const step = this.extent > 4 ? 2 ** Math.ceil(Math.log2(this.extent / 4)) : 1;
    for (let metres = step; metres < this.extent * 1.4; metres += step) {
      context.beginPath();
      context.arc(SIDE / 2, SIDE / 2, metres * metre, 0, 7);
      context.stroke();
    }
    const [x, y] = camera.map((share) => SIDE / 2 + share * (SIDE / 2 - 16));
    context.fillStyle = "#a3a3a3";
    context.font = "20px sans-serif";
    context.textAlign = camera[0] ? "right" : "center";
    context.fillText("camera", camera[0] ? SIDE - 8 : x, camera[0] ? y - 8 : y + 8);
    context.textAlign = "left";
    context.fillText(`${step} m`, SIDE / 2 + 4, SIDE / 2 - step * metre - 4);
  }

  /** A lamp where it stands, and a distant light as a tick at the edge that it comes from. */
  drawLight(context, axes, light, active, selected) {
    const colour = toHex(chroma(power(light, this.viewer.tints)));
    context.globalAlpha = active ? 1 : 0.4;
    context.strokeStyle = context.fillStyle = colour;
    context.lineWidth = 3;
    context.beginPath();
    if (isNear(light)) {
      const [x, y] = this.shownAt(light.position, axes);
      if (selected) {
        context.setLineDash([4, 5]);
        context.moveTo(x, y);
        context.lineTo(SIDE / 2, SIDE / 2);
        context.stroke();
        context.setLineDash([]);
        context.beginPath();
        context.arc(x, y, 15, 0, 7);
        context.strokeStyle = "#f0b35a";
        context.stroke();
        context.beginPath();
      }
      context.roundRect(x - 8, y - 8, 16, 16, 5);
      context.fill();
    } else {
      const [[right, toRight], [up, toUp]] = axes;
      const toward = direction(light);
      const [across, above] = [toRight * toward[right], toUp * toward[up]];
      for (const share of [0.86, 0.98])
        context.lineTo(SIDE / 2 + across * share * (SIDE / 2), SIDE / 2 - above * share * (SIDE / 2));
      context.stroke();
    }
    context.globalAlpha = 1;
  }
}

// The photograph on a canvas that can be zoomed and moved, and what is drawn over it.
//
// Places are shares of the photograph's width and height; spots are CSS pixels of the canvas.

import { fitting, panned, zoomed } from "../viewer.js";

const ZOOM = [0.5, 16]; // of the scale at which all of the photograph is seen
const LINE = "#f0b35a";
const OUTLINED = "rgb(0 0 0 / 60%)"; // around lines, which are seen on any photograph

export class Paper {
  constructor(canvas) {
    this.canvas = canvas;
    this.image = null;
    this.view = null;
  }

  /** A pointer's spot. */
  at(event) {
    const bounds = this.canvas.getBoundingClientRect();
    return [event.clientX - bounds.left, event.clientY - bounds.top];
  }

  /**
   * A spot's place on the photograph.
   * @param {number[]} spot
   */
  share([x, y]) {
    const { scale, left, top } = this.view;
    return [(x - left) / (scale * this.image.width), (y - top) / (scale * this.image.height)];
  }

  /**
   * A place's spot on the canvas.
   * @param {number[]} place
   */
  spot([across, down]) {
    const { scale, left, top } = this.view;
    return [left + across * scale * this.image.width, top + down * scale * this.image.height];
  }

  /** CSS pixels that the photograph is wide. */
  get width() {
    return this.view.scale * this.image.width;
  }

  /** Shows all of the photograph. */
  fit() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.view = fitting([width, height], [this.image.width, this.image.height], Math.min(24, width / 20));
  }

  zoom(times, about = [this.canvas.clientWidth / 2, this.canvas.clientHeight / 2]) {
    this.view = zoomed(this.view, times, about, about, ZOOM);
  }

  /** Moves and zooms with fingers, or one pointer. */
  pan(view, began, now) {
    this.view = panned(view, began, now, ZOOM);
  }

  // --- painting

  /** Paints the photograph, and over it what is not the person; or the matte alone, `grey`. */
  begin(veil, grey) {
    const { canvas } = this;
    const density = devicePixelRatio || 1;
    const size = [canvas.clientWidth, canvas.clientHeight].map((side) => Math.round(side * density));
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    const context = (this.context = canvas.getContext("2d"));
    context.setTransform(density, 0, 0, density, 0, 0);
    context.clearRect(0, 0, canvas.width, canvas.height);
    const { scale, left, top } = this.view;
    const frame = [left, top, this.image.width * scale, this.image.height * scale];
    context.imageSmoothingQuality = "high";
    context.drawImage(grey ?? this.image, ...frame);
    if (veil && !grey) context.drawImage(veil, ...frame);
  }

  /** Paints a line through places, and a dot at each of `corners`. */
  trace(places, closed, corners = []) {
    const { context } = this;
    if (!places.length) return;
    context.beginPath();
    for (const place of places) context.lineTo(...this.spot(place));
    if (closed) context.closePath();
    this.ink(4, 2, LINE);
    for (const corner of corners) {
      context.beginPath();
      context.arc(...this.spot(corner), 4, 0, 7);
      context.fillStyle = LINE;
      context.fill();
      context.stroke();
    }
  }

  /** Paints a light line around somebody; a strong one where they are marked. */
  contour(places, marked) {
    const { context } = this;
    context.beginPath();
    for (const place of places) context.lineTo(...this.spot(place));
    context.closePath();
    this.ink(marked ? 4 : 2.4, marked ? 2 : 1, marked ? LINE : "#fff");
  }

  /** Paints a brush's stroke; `radius` in CSS pixels. */
  brush(places, person, radius) {
    const { context } = this;
    context.beginPath();
    for (const place of places) context.lineTo(...this.spot(place));
    if (places.length === 1) context.lineTo(...this.spot(places[0]));
    context.lineCap = context.lineJoin = "round";
    context.lineWidth = 2 * radius;
    context.strokeStyle = person ? "rgb(112 214 150 / 65%)" : "rgb(240 112 100 / 65%)";
    context.stroke();
  }

  /** Paints the pen: the brush's ring, or a cross where `radius` is null. */
  pen([x, y], radius) {
    const { context } = this;
    context.beginPath();
    if (radius !== null) context.arc(x, y, radius, 0, 7);
    else {
      for (const [across, down] of [
        [8, 0],
        [0, 8],
      ]) {
        context.moveTo(x - across, y - down);
        context.lineTo(x + across, y + down);
      }
    }
    this.ink(3, 1.2, "#fff");
  }

  ink(outer, inner, colour) {
    for (const [width, style] of [
      [outer, OUTLINED],
      [inner, colour],
    ]) {
      this.context.lineWidth = width;
      this.context.strokeStyle = style;
      this.context.stroke();
    }
  }
}

/** A grey bitmap, a matte, as a canvas that dims what is outside it. */
export function veilOf(matte) {
  const veil = document.createElement("canvas");
  [veil.width, veil.height] = [matte.width, matte.height];
  const context = veil.getContext("2d");
  context.drawImage(matte, 0, 0);
  const pixels = context.getImageData(0, 0, veil.width, veil.height);
  for (let at = 0; at < pixels.data.length; at += 4) {
    const outside = 255 - pixels.data[at];
    pixels.data.set([24, 25, 28, outside * 0.86], at);
  }
  context.putImageData(pixels, 0, 0);
  return veil;
}

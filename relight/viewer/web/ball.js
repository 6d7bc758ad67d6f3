// A small matte sphere, lit by lights as the person is: where they stand, at a glance.

import { encoded } from "./colour.js";
import { direction, dot, softness } from "./lights.js";

/** Paints lights, [{ light, colour: [r, g, b] }], on a square canvas; `ambient` keeps its night side visible. */
export function paintBall(canvas, lights, ambient = 0.02) {
  const size = canvas.width;
  const context = canvas.getContext("2d");
  const image = context.createImageData(size, size);
  const lit = lights.map(({ light, colour }) => ({ toward: direction(light), soft: softness(light) / 180, colour }));
  const radius = size / 2 - 1;
  for (let y = 0; y < size; y++) {
    for (let x = 0; x < size; x++) {
      const across = (x + 0.5 - size / 2) / radius;
      const up = (size / 2 - y - 0.5) / radius;
      const beyond = Math.hypot(across, up);
      if (beyond > 1 + 1 / radius) continue;
      const flat = Math.max(beyond, 1);
      const normal = [across / flat, up / flat, Math.sqrt(Math.max(0, 1 - beyond * beyond))];
      const light = [ambient, ambient, ambient];
      for (const { toward, soft, colour } of lit) {
        const facing = Math.max(0, (dot(normal, toward) + soft) / (1 + soft)); // a wide light wraps around
        for (let channel = 0; channel < 3; channel++) light[channel] += facing * colour[channel];
      }
      const place = (y * size + x) * 4;
      for (let channel = 0; channel < 3; channel++) {
        image.data[place + channel] = 255 * encoded(light[channel] / (1 + light[channel] * 0.15));
      }
      image.data[place + 3] = 255 * Math.min(1, Math.max(0, (1 - beyond) * radius + 0.5));
    }
  }
  context.putImageData(image, 0, 0);
}

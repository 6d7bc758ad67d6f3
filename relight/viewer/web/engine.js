// The picture: WebGL2 passes that repeat relight.Subject.relit, and how it is shown.
//
//   light    for each light, on the networks' canvas: its shading and its visibility (a layer each)
//   near     the same for a lamp in the room
//            both also draw its gloss, once there is any
//   sum      Σ colour · layer                                                        (on the canvas)
//   enlarge  joint bilateral upsampling to the person's pixels                       (on the plate)
//   compose  (× albedo + gloss, mixed with the photograph) × coverage; or another look         (the picture)
//   reduce   the brightest value of the picture, which becomes the display's white
//   show     highlights rolled off, over the background, encoded for the display
//
// Off-screen images have their top row first: row 0 of a texture is the picture's top row.

import { Unsupported, program, setUniform, target, texture } from "./gl.js";
import { LUMINANCE, dot, isNear } from "./lights.js";

export const { LIGHTS } = PYTHON; // of which each can be alone; the layer after them is the environment's
const LAYERS = LIGHTS + 1;
const ROWS = 14; // vec4 a sample: see shaders/light.glsl
const RAYS = 16; // to a lamp that has a size: SAMPLES of relight/lights/near.py
const TABLE = 128; // sides of the table of the components' weights by direction
const BATCH = 60; // samples a draw: 60 · 14 vec4 fit the 16 KiB that every uniform block may have
const PARTS = { light: "gloss", near: "gloss", compose: "backdrop", show: "backdrop" }; // that programs share
const [SHADING, GLOSS] = [0, 1];
export const LOOKS = ["picture", "light", "visibility", "normals", "albedo", "photograph"];

export class Engine {
  /** `pack`: what `unpack` gives, and its images decoded; `room`: the Room of it; `shaders`: {name: text}. */
  constructor(canvas, pack, room, shaders) {
    this.canvas = canvas;
    this.pack = pack;
    this.room = room;
    this.shaders = shaders;
    const { size, box, canvas: field } = pack.description;
    [canvas.width, canvas.height] = size;
    this.size = size;
    this.box = box;
    this.field = field;
    this.mixes = mixes(pack);
    this.looks = LOOKS;
    this.place = { scale: 1, right: 0, up: 0 }; // of the photograph in the picture, see state.js
    this.restore();
  }

  /** Makes all that lives on the GPU, the first time and after the context was lost. */
  restore() {
    const options = { alpha: true, antialias: false, depth: false, preserveDrawingBuffer: true };
    const gl = (this.gl = this.canvas.getContext("webgl2", options));
    if (!gl) throw new Unsupported("This browser has no WebGL 2, which the picture is drawn with.");
    const floats = [gl.getExtension("EXT_color_buffer_float"), gl.getExtension("EXT_color_buffer_half_float")];
    if (!floats[0] && !floats[1]) {
      throw new Unsupported("This graphics driver cannot draw to float images, which light is summed in.");
    }
    this.programs = Object.fromEntries(
      ["light", "near", "sum", "prepare", "enlarge", "compose", "reduce", "show"].map((name) => [
        name,
        program(gl, this.shaders.quad, this.shaders.common + (this.shaders[PARTS[name]] ?? "") + this.shaders[name]),
      ]),
    );
    gl.bindVertexArray(gl.createVertexArray());
    this.layers = Array(LAYERS).fill(null); // what each layer shows: the samples it was drawn from
    this.glossy = null; // the same for the gloss, once there is any: { lit, light, layers }
    this.gloss = 0;
    this.amount = 1;
    this.photographed = 0;
    this.enlarged = null; // the normals, once they are asked for
    this.table = null; // of the components' weights, once there is a lamp
    this.background = null;
    this.shadow = null;
    this.before = null; // the sum of the photograph's colours, once it is asked for
    this.makeTextures();
    this.block = gl.createBuffer();
    gl.bindBuffer(gl.UNIFORM_BUFFER, this.block);
    gl.bufferData(gl.UNIFORM_BUFFER, BATCH * ROWS * 16, gl.DYNAMIC_DRAW);
    gl.bindBufferBase(gl.UNIFORM_BUFFER, 0, this.block);
    gl.uniformBlockBinding(this.programs.light.handle, this.programs.light.block, 0);
    this.prepare();
  }

  /** Whether the browser has taken the GPU away, for a while. */
  get lost() {
    return this.gl.isContextLost();
  }

  makeTextures() {
    const { gl, field, box, size, pack } = this;
    const { arrays, images } = pack;
    const [width, height] = field;
    const layers = arrays.features.shape[0] / 4;
    this.features = texture(gl, { size: field, layers, data: interleaved(arrays.features) });
    this.surface = texture(gl, { size: field, format: "half", data: interleaved(arrays.surface) });
    this.rim = texture(gl, { size: field, format: "grey", data: arrays.rim.data });
    this.positions = texture(gl, { size: field, format: "float", data: this.room.positions });
    this.guide = texture(gl, { size: field, data: interleaved(arrays.guide) });
    this.matte = texture(gl, { size: box.slice(2), format: "grey", data: arrays.matte.data });
    this.photograph = texture(gl, { size: box.slice(2), format: "sRGB", data: images.photograph });
    this.albedo = texture(gl, { size: box.slice(2), format: "sRGB", data: images.albedo });
    this.lit = target(gl, { size: [width, height], layers: LAYERS, format: "half" });
    this.total = target(gl, { size: [width, height], format: "half" });
    this.plateGuide = target(gl, { size: box.slice(2) });
    this.light = target(gl, { size: box.slice(2), format: "half" });
    this.picture = target(gl, { size, format: "half" });
    this.shown = target(gl, { size });
    this.reductions = [];
    for (let sides = size; sides[0] > 1 || sides[1] > 1 || !this.reductions.length;) {
      sides = sides.map((side) => Math.ceil(side / 8));
      this.reductions.push(target(gl, { size: sides, format: "half" }));
    }
    this.setBackground(this.backdrop ?? null);
    this.setFloorShadow(this.floorShadow ?? null);
  }

  /** The plate's guide, which tells the enlargement what looks alike, and the matte. */
  prepare() {
    const { exposure, brightest } = this.pack.description;
    this.draw("prepare", this.plateGuide, {
      photograph: this.photograph,
      matte: this.matte,
      exposure,
      brightest,
    });
  }

  /** A picture to be behind the person, {width, height, rgb: Float32Array}; null for none. */
  setBackground(picture) {
    this.backdrop = picture;
    if (this.background) this.gl.deleteTexture(this.background.handle);
    this.background = this.textureOf(picture);
  }

  /**
   * The factors, a picture of any size, by which the person's shadow on the floor dims the background; null for none.
   */
  setFloorShadow(picture) {
    this.floorShadow = picture;
    if (this.shadow) this.gl.deleteTexture(this.shadow.handle);
    this.shadow = this.textureOf(picture);
  }

  /** A texture of a picture; a black pixel for null. */
  textureOf(picture) {
    const { gl } = this;
    const { width, height, rgb } = picture ?? { width: 1, height: 1, rgb: new Float32Array(3) };
    const data = new Float32Array(width * height * 4);
    for (let pixel = 0; pixel < width * height; pixel++) {
      for (let channel = 0; channel < 3; channel++)
        data[pixel * 4 + channel] = Math.min(rgb[pixel * 3 + channel], 65504);
    }
    return texture(gl, { size: [width, height], format: "float", data, mipmaps: true });
  }

  /**
   * Draws the light of these layers: [{ samples, colour: [r, g, b] }], by slot; null where there is none.
   * Samples are those of `lights.js`, or a lamp { position, radius }; a layer whose samples are the same object
   * as before is not drawn again. `gloss`: strength of the reflection at grazing angles, from 0 to 1. `amount`: share
   * of these lights, `photographed` that of the photograph.
   */
  setLights(layers, gloss = 0, amount = 1, photographed = 1 - amount) {
    this.gloss = gloss;
    this.amount = amount;
    this.photographed = photographed;
    const colours = new Float32Array(LAYERS * 3);
    layers.forEach((layer, slot) => layer && colours.set(layer.colour, slot * 3));
    // Half floats hold 65504: the sum is kept within about one, and its scale apart.
    this.scale = Math.max(
      1,
      colours.reduce((sum, value) => sum + value, 0),
    );
    if (gloss > 0) {
      const { gl, field, box } = this;
      this.glossy ??= {
        lit: target(gl, { size: field, layers: LAYERS, format: "half" }),
        light: target(gl, { size: box.slice(2), format: "half" }),
        layers: Array(LAYERS).fill(null),
      };
      this.drawLights(layers, colours, this.glossy, GLOSS);
    }
    this.drawLights(layers, colours, this, SHADING);
  }

  /** Draws the layers that have changed, and their sum on the plate; `into`: { lit, light, layers }. */
  drawLights(layers, colours, into, part) {
    layers.forEach((layer, slot) => {
      if (!layer || into.layers[slot] === layer.samples) return;
      into.layers[slot] = layer.samples;
      const destination = { ...into.lit, layer: slot };
      if (isNear(layer.samples)) this.drawLamp(destination, layer.samples, part);
      else this.drawLayer(destination, layer.samples, part);
    });
    const lamps = layers.flatMap((layer) =>
      layer && isNear(layer.samples) ? [...layer.samples.position, layer.samples.radius] : [0, 0, 0, -1],
    );
    const shares = new Float32Array(LAYERS);
    const strengths = layers.map((layer) => (layer ? Math.max(dot(LUMINANCE, layer.colour), 1e-9) : 0));
    const all = strengths.reduce((sum, value) => sum + value, 0);
    strengths.forEach((strength, slot) => (shares[slot] = all ? strength / all : 0));
    this.draw("sum", this.total, {
      layers: into.lit,
      positions: this.positions,
      "lamps[0]": { quads: new Float32Array(lamps) },
      "colours[0]": { vectors: colours.map((value) => value / this.scale) },
      "shares[0]": { numbers: shares },
    });
    this.enlarge(this.total, into.light);
  }

  drawLayer(destination, samples, part) {
    const { gl } = this;
    const total = samples.reduce((sum, { power }) => sum + dot(LUMINANCE, power), 0) || 1;
    for (let first = 0; first < Math.max(1, samples.length); first += BATCH) {
      const batch = samples.slice(first, first + BATCH);
      const rows = new Float32Array(BATCH * ROWS * 4);
      batch.forEach((sample, index) => this.writeSample(rows.subarray(index * ROWS * 4), sample));
      gl.bindBuffer(gl.UNIFORM_BUFFER, this.block);
      gl.bufferSubData(gl.UNIFORM_BUFFER, 0, rows);
      if (first) gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE);
      this.draw("light", destination, {
        features: this.features,
        surface: this.surface,
        rim: this.rim,
        count: { whole: batch.length },
        residualBias: this.pack.description.residualBias,
        part: { whole: part },
        share: 1 / total,
      });
      gl.disable(gl.BLEND);
    }
  }

  drawLamp(destination, { position, radius }, part) {
    const sides = position.map(Math.abs);
    const least = sides.indexOf(Math.min(...sides));
    this.table ??= texture(this.gl, {
      size: [TABLE, TABLE],
      layers: 13,
      format: "float",
      data: this.tableOf(),
      smooth: true,
    });
    this.draw("near", destination, {
      features: this.features,
      surface: this.surface,
      rim: this.rim,
      positions: this.positions,
      table: this.table,
      position,
      axis: [0, 1, 2].map((side) => Number(side === least)),
      radius,
      rays: radius ? RAYS : 1,
      residualBias: this.pack.description.residualBias,
      part: { whole: part },
    });
  }

  /** The components' weights in all directions, on an octahedral map: see shaders/near.glsl. */
  tableOf() {
    if (this.weights) return this.weights;
    const texels = TABLE * TABLE;
    this.weights = new Float32Array(texels * 4 * 13);
    for (let texel = 0; texel < texels; texel++) {
      const [right, up] = [texel % TABLE, Math.floor(texel / TABLE)].map((place) => (2 * place) / (TABLE - 1) - 1);
      const front = 1 - Math.abs(right) - Math.abs(up);
      const fold = (value, other) => (front < 0 ? (1 - Math.abs(other)) * (value < 0 ? -1 : 1) : value);
      const place = [fold(right, up), fold(up, right), front];
      const length = Math.hypot(...place);
      const { shadow, bounce } = this.weightsOf(place.map((value) => value / length));
      const rows = [...shadow.subarray(0, -1), ...bounce.subarray(0, -1), shadow.at(-1), bounce.at(-1)];
      rows.forEach(
        (value, index) => (this.weights[(Math.floor(index / 4) * texels + texel) * 4 + (index % 4)] = value),
      );
    }
    return this.weights;
  }

  /** The weights of the components in a direction: those of anchors near it, mixed. */
  weightsOf(toward) {
    const { anchors, cast, residual } = this.mixes;
    const nearness = anchors.map((anchor) => Math.exp(this.pack.description.kappa * (dot(anchor, toward) - 1)));
    const total = nearness.reduce((sum, value) => sum + value, 0);
    const mixed = (mix) => {
      const weights = new Float64Array(mix[0].length);
      nearness.forEach((value, anchor) => {
        if (value < 1e-9 * total) return;
        const parts = mix[anchor];
        for (let index = 0; index < parts.length; index++) weights[index] += (parts[index] * value) / total;
      });
      return weights;
    };
    return { shadow: mixed(cast), bounce: mixed(residual) };
  }

  writeSample(row, { toward, power }) {
    const { shadow, bounce } = this.weightsOf(toward);
    row.set([...toward, shadow.at(-1), ...power, bounce.at(-1)]);
    row.set(shadow.subarray(0, -1), 8);
    row.set(bounce.subarray(0, -1), 8 + shadow.length - 1);
  }

  enlarge(source, destination) {
    const { centre, scale } = this.pack.description;
    this.draw("enlarge", destination, {
      source,
      guide: this.guide,
      plateGuide: this.plateGuide,
      centre,
      scale,
    });
  }

  /** A look of LOOKS as linear light or data, in `this.picture`; `background`: null, [r, g, b] or "picture". */
  compose(look, background) {
    if (look === "normals" && !this.enlarged) {
      this.enlarged = target(this.gl, { size: this.box.slice(2), format: "half" });
      this.enlarge(this.surface, this.enlarged);
    }
    this.draw("compose", this.picture, {
      light: look === "normals" ? this.enlarged : this.light,
      reflection: this.glossy?.light ?? this.light,
      gloss: this.gloss,
      amount: this.amount,
      photographed: this.photographed,
      plateGuide: this.plateGuide,
      albedo: this.albedo,
      photograph: this.photograph,
      box: this.box,
      place: [this.place.scale, this.place.right * this.size[0], -this.place.up * this.size[1]],
      look: { whole: LOOKS.indexOf(look) },
      lightScale: this.scale,
      gain: this.pack.description.gain,
      ...this.behind(background),
    });
  }

  /** What shaders/backdrop.glsl shows behind the person. */
  behind(background, blur = 0) {
    return {
      blur,
      background: this.background,
      shadow: this.shadow,
      shadowed: { whole: Number(Boolean(this.floorShadow)) },
      shadowAmount: this.amount,
      backgroundSize: this.backdrop ? [this.backdrop.width, this.backdrop.height] : [1, 1],
      size: this.size,
      behind: { whole: background === null ? 0 : background === "picture" ? 2 : 1 },
      backgroundColour: Array.isArray(background) ? background : [0, 0, 0],
    };
  }

  /** Shows a look on the page's canvas; `part`: from and to, shares of the width. */
  show(look, { part = [0, 1], ...settings }) {
    const { gl, size } = this;
    const left = Math.round(part[0] * size[0]);
    const right = Math.round(part[1] * size[0]);
    gl.enable(gl.SCISSOR_TEST);
    this.encode(look, settings, null, [left, 0, Math.max(right - left, 0), size[1]]);
    gl.disable(gl.SCISSOR_TEST);
  }

  /**
   * `backgroundLight`: share of the picture's new light that reaches the background; `blur`: of the background, its
   * radius as a share of the picture's height. The photograph has neither.
   */
  encode(look, settings, destination, scissor = null) {
    const { exposure, background, backgroundLight = 0, blur = 0 } = settings;
    const share = look === "picture" && background !== null ? backgroundLight : 0;
    if (share) this.before ??= this.sumOfPhotograph();
    const data = look === "visibility" || look === "normals";
    this.gl.disable(this.gl.SCISSOR_TEST);
    const source = this.reduced(look);
    if (scissor) {
      this.gl.enable(this.gl.SCISSOR_TEST);
      this.gl.scissor(...scissor);
    }
    this.draw("show", destination, {
      picture: this.picture,
      brightest: source,
      gain: data || look === "albedo" ? 1 : 2 ** exposure,
      data: { whole: Number(data) },
      rows: destination ? 0 : this.size[1],
      before: this.before ?? [1, 1, 1],
      backgroundLight: share,
      ...this.behind(data || look === "albedo" ? null : background, look === "photograph" ? 0 : blur),
    });
  }

  /** Composes a look; returns one pixel with its brightest value and the sum of its colours. */
  reduced(look) {
    this.compose(look, null);
    let source = this.picture;
    for (const next of this.reductions) {
      this.draw("reduce", next, { source, first: { whole: Number(source === this.picture) } });
      source = next;
    }
    return source;
  }

  sumOfPhotograph() {
    const pixel = new Float32Array(4);
    const { framebuffer } = this.reduced("photograph");
    this.gl.bindFramebuffer(this.gl.FRAMEBUFFER, framebuffer);
    this.gl.readPixels(0, 0, 1, 1, this.gl.RGBA, this.gl.FLOAT, pixel);
    return [...pixel.subarray(1)];
  }

  /** The picture as {width, height, data}: linear premultiplied RGBA, Float32Array, top row first. */
  read(background = null) {
    this.compose("picture", background);
    const data = new Float32Array(this.size[0] * this.size[1] * 4);
    this.readPixels(this.picture, this.gl.FLOAT, data);
    return { width: this.size[0], height: this.size[1], data };
  }

  /** What is shown, as {width, height, data}: encoded RGBA bytes with straight alpha, top row first. */
  readShown(look, settings) {
    this.encode(look, settings, this.shown);
    const data = new Uint8Array(this.size[0] * this.size[1] * 4);
    this.readPixels(this.shown, this.gl.UNSIGNED_BYTE, data);
    return { width: this.size[0], height: this.size[1], data };
  }

  readPixels({ framebuffer, size }, type, data) {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.readPixels(0, 0, ...size, gl.RGBA, type, data);
  }

  /** Waits until all is drawn: reading a pixel does. */
  finish() {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  }

  /** Gives the GPU's memory back; nothing can be drawn after it. */
  close() {
    this.gl.getExtension("WEBGL_lose_context")?.loseContext();
  }

  /** One pass over all pixels of a target, or of the page's canvas if it is null. */
  draw(name, destination, uniforms) {
    const { gl } = this;
    const { handle, places } = this.programs[name];
    gl.useProgram(handle);
    let unit = 0;
    for (const [key, value] of Object.entries(uniforms)) {
      const place = places[key];
      if (place === undefined) continue; // the compiler found no use for it
      if (value.handle) {
        gl.activeTexture(gl.TEXTURE0 + unit);
        gl.bindTexture(value.kind, value.handle);
        gl.uniform1i(place, unit++);
      } else setUniform(gl, place, value);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, destination?.framebuffer ?? null);
    if (destination?.layer !== undefined) {
      gl.framebufferTextureLayer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, destination.handle, 0, destination.layer);
    }
    gl.viewport(0, 0, ...(destination?.size ?? this.size));
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
}

function mixes({ arrays }) {
  const rows = ({ data, shape }) =>
    Array.from({ length: shape[0] }, (_, row) => Array.from(data.subarray(row * shape[1], (row + 1) * shape[1])));
  return { anchors: rows(arrays.anchors), cast: rows(arrays.cast), residual: rows(arrays.residual) };
}

/** Planes (4 n, h, w) as n images of four channels. */
function interleaved({ data, shape }) {
  const [planes, height, width] = shape;
  const pixels = height * width;
  const images = new data.constructor(data.length);
  for (let plane = 0; plane < planes; plane++) {
    const offset = Math.floor(plane / 4) * pixels * 4 + (plane % 4);
    for (let pixel = 0; pixel < pixels; pixel++) images[offset + pixel * 4] = data[plane * pixels + pixel];
  }
  return images;
}

// WebGL 2 in few words: textures, targets to draw on, programs and their uniforms.

/** A browser that cannot show the page: what it lacks, for the person who opened it. */
export class Unsupported extends Error {}

/** Internal format, channels and type of a texture, by name. */
function formats(gl) {
  return {
    bytes: [gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE],
    grey: [gl.R8, gl.RED, gl.UNSIGNED_BYTE],
    half: [gl.RGBA16F, gl.RGBA, gl.HALF_FLOAT],
    float: [gl.RGBA16F, gl.RGBA, gl.FLOAT],
    sRGB: [gl.SRGB8_ALPHA8, gl.RGBA, gl.UNSIGNED_BYTE],
  };
}

/**
 * A texture, or with `layers` an array of them; `data`: its pixels, top row first.
 * @param {WebGL2RenderingContext} gl
 * @param {{ size: number[], layers?: number, format?: string, data?: any, mipmaps?: boolean,
 *   smooth?: boolean }} options
 */
export function texture(gl, { size, layers, format = "bytes", data = null, mipmaps = false, smooth = mipmaps }) {
  const kind = layers ? gl.TEXTURE_2D_ARRAY : gl.TEXTURE_2D;
  const handle = gl.createTexture();
  const [internal, channels, type] = formats(gl)[format];
  gl.bindTexture(kind, handle);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
  if (layers) gl.texImage3D(kind, 0, internal, size[0], size[1], layers, 0, channels, type, data);
  else gl.texImage2D(kind, 0, internal, size[0], size[1], 0, channels, type, data);
  if (mipmaps) gl.generateMipmap(kind);
  gl.texParameteri(kind, gl.TEXTURE_MIN_FILTER, mipmaps ? gl.LINEAR_MIPMAP_LINEAR : smooth ? gl.LINEAR : gl.NEAREST);
  gl.texParameteri(kind, gl.TEXTURE_MAG_FILTER, smooth ? gl.LINEAR : gl.NEAREST);
  for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(kind, side, gl.CLAMP_TO_EDGE);
  return { handle, kind, size };
}

/** A texture that can be drawn on. */
export function target(gl, options) {
  const made = texture(gl, options);
  const framebuffer = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
  if (options.layers) gl.framebufferTextureLayer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, made.handle, 0, 0);
  else gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, made.handle, 0);
  return { ...made, framebuffer };
}

/** A program of two shaders, with the places of its uniforms; Unsupported where the driver refuses them. */
export function program(gl, vertex, fragment) {
  const handle = gl.createProgram();
  for (const [type, text] of [
    [gl.VERTEX_SHADER, vertex],
    [gl.FRAGMENT_SHADER, fragment],
  ]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(handle, shader);
  }
  gl.linkProgram(handle);
  if (!gl.getProgramParameter(handle, gl.LINK_STATUS) && !gl.isContextLost()) {
    const logs = gl.getAttachedShaders(handle).map((shader) => gl.getShaderInfoLog(shader));
    throw new Unsupported(`This graphics driver refuses a shader: ${gl.getProgramInfoLog(handle)} ${logs.join(" ")}`);
  }
  const places = {};
  const count = gl.getProgramParameter(handle, gl.ACTIVE_UNIFORMS) ?? 0;
  for (let index = 0; index < count; index++) {
    const { name } = gl.getActiveUniform(handle, index);
    const place = gl.getUniformLocation(handle, name);
    if (place !== null) places[name] = place;
  }
  return { handle, places, block: gl.getUniformBlockIndex(handle, "Samples") };
}

/** Sets a uniform: a number, { whole }, { vectors }, { quads }, { numbers }, or a vector of two to four numbers. */
export function setUniform(gl, place, value) {
  if (typeof value === "number") gl.uniform1f(place, value);
  else if (value.whole !== undefined) gl.uniform1i(place, value.whole);
  else if (value.vectors) gl.uniform3fv(place, value.vectors);
  else if (value.quads) gl.uniform4fv(place, value.quads);
  else if (value.numbers) gl.uniform1fv(place, value.numbers);
  else gl[`uniform${value.length}fv`](place, value);
}

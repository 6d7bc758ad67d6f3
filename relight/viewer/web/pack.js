// What Python packed of a subject: see relight/viewer/packing.py, which this file reads.

/** Bytes of a pack to { description, arrays: {name: typed array}, files: {name: Blob} }. */
export async function unpack(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const length = view.getUint32(0, true);
  const description = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + length)));
  const parts = [];
  let start = 4 + length;
  for (const size of description.parts) {
    parts.push(bytes.subarray(start, start + size));
    start += size;
  }
  const stream = new Blob([parts[0]]).stream().pipeThrough(new DecompressionStream("deflate"));
  const inflated = new Uint8Array(await new Response(stream).arrayBuffer());
  const [photograph, albedo] = parts.slice(1).map((part) => new Blob([part], { type: "image/jpeg" }));
  return { description, arrays: separate(inflated, description.arrays), files: { photograph, albedo } };
}

const TYPES = { uint8: Uint8Array, uint16: Uint16Array, float32: Float32Array };

function separate(bytes, specs) {
  const arrays = {};
  let start = 0;
  for (const { name, type, shape } of specs) {
    const Type = TYPES[type];
    const count = shape.reduce((product, side) => product * side, 1);
    const planes = bytes.subarray(start, start + count * Type.BYTES_PER_ELEMENT);
    arrays[name] = { shape, data: new Type(joined(planes, count, shape.at(-1), Type.BYTES_PER_ELEMENT).buffer) };
    start += planes.length;
  }
  return arrays;
}

/** Planes of bytes, each byte less the one before it in its row, to the bytes of values. */
function joined(planes, count, width, size) {
  const values = new Uint8Array(planes.length);
  for (let plane = 0; plane < size; plane++) {
    let last = 0;
    for (let index = 0; index < count; index++) {
      if (index % width === 0) last = 0;
      last = (last + planes[plane * count + index]) & 255;
      values[index * size + plane] = last;
    }
  }
  return values;
}

/** Base64 to bytes. */
export function fromBase64(text) {
  const characters = atob(text.trim());
  const bytes = new Uint8Array(characters.length);
  for (let index = 0; index < bytes.length; index++) bytes[index] = characters.charCodeAt(index);
  return bytes;
}

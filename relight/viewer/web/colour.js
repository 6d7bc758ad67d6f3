// Colours: linear Rec.709, sRGB codes, and "#rrggbb" as inputs of colour have it.

export const decoded = (code) => (code <= 0.04045 ? code / 12.92 : ((code + 0.055) / 1.055) ** 2.4);
export const encoded = (light) => (light <= 0.0031308 ? light * 12.92 : 1.055 * light ** (1 / 2.4) - 0.055);

/** Linear RGB as "#rrggbb"; values above one become one. */
export const toHex = (colour) =>
  `#${colour
    .map((value) =>
      Math.round(255 * encoded(Math.min(1, value)))
        .toString(16)
        .padStart(2, "0"),
    )
    .join("")}`;

/** "#rrggbb" as linear RGB. */
export const fromHex = (text) => [1, 3, 5].map((at) => decoded(parseInt(text.slice(at, at + 2), 16) / 255));

/** A colour scaled so that its brightest channel is one, or black. */
export function chroma(colour) {
  const most = Math.max(...colour);
  return colour.map((value) => (most ? value / most : 0));
}

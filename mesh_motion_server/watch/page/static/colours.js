// The map "viridis" (van der Walt and Smith, SciPy 2015), as in the pictures of `mesh-motion plot`: lightness is uniform;
// the order is visible also without colour and for colour-blind readers. A quality has the same colour
// in light and dark mode, here and in pictures.

const VIRIDIS = (
  "440154 460c5f 47186a 482273 472c7b 453681 424085 3e4989 3a528b 365a8c 32628d 2f6a8d 2c728e 287a8e 26818e 23898d 20908c " +
  "1e978a 1e9e88 21a685 27ad80 30b47a 3dbb74 4bc26c 5bc862 6dce58 81d34c 95d73f aadb32 bfdf24 d4e11a e9e419 fde724"
)
  .split(" ")
  .map((hex) => [0, 2, 4].map((at) => parseInt(hex.slice(at, at + 2), 16)));

/** Red, green, blue in 0 … 255 of a quality in 0 … 1. */
export function colourOf(value) {
  const place = Math.min(1, Math.max(0, value)) * (VIRIDIS.length - 1);
  const low = Math.min(VIRIDIS.length - 2, Math.floor(place));
  return VIRIDIS[low].map((x, k) => x + (place - low) * (VIRIDIS[low + 1][k] - x));
}

/** The map as bytes of 256 pixels with alpha. */
export function table() {
  const bytes = new Uint8ClampedArray(4 * 256);
  for (let k = 0; k < 256; k++) bytes.set([...colourOf(k / 255), 255], 4 * k);
  return bytes;
}

export function paintScale(canvas) {
  const pen = canvas.getContext("2d");
  pen.putImageData(new ImageData(table(), 256, 1), 0, 0);
}

/** "#rrggbb" as three numbers in 0 … 1. */
export const channels = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255);

// The map "deep" of cmocean (Thyng, Greene, Hetland, Zimmerle, DiMarco, Oceanography 29, 2016; vendor/cmocean/LICENSE): even in
// lightness and told apart by colour-blind eyes. The ideal cell has the colour next to the ground, pale by day and dark by
// night, so that a good mesh is calm and what is bad stands out.

const DEEP = "281a2c 322541 3b315a 413d75 404c8b 3e5e93 3f6e97 437e9a 488e9e 4e9ea1 55aea3 62bfa4 78cea3 98daa4 bbe6ac ddf2ba fdfecc"
  .split(" ")
  .map((hex) => [0, 2, 4].map((at) => parseInt(hex.slice(at, at + 2), 16)));

export const byNight = matchMedia("(prefers-color-scheme: dark)");

/** Red, green, blue in 0 … 255 of a quality in 0 … 1. */
export function colourOf(value) {
  const bounded = Math.min(1, Math.max(0, value));
  const place = (byNight.matches ? 1 - bounded : bounded) * (DEEP.length - 1);
  const low = Math.min(DEEP.length - 2, Math.floor(place));
  return DEEP[low].map((x, k) => x + (place - low) * (DEEP[low + 1][k] - x));
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

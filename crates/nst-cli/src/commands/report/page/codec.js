// Pictures as the page stores them: base64 of a zlib stream of five planes of bytes. R, G and
// B are the magnitudes of a pixel's channels, E is the exponent that they share, and bit c of
// S is set where channel c is negative: x = ± magnitude · 2^(E − 136); E = 0 is black, and
// E = 255 a pixel that is not finite. Each byte is the difference from its left neighbour,
// modulo 256.

/** The exponent of pixels that are not finite. */
export const NOT_FINITE = 255;

/** `{ width, height, planes }` of a stored picture. */
export async function decode(text, width, height) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const all = new Uint8Array(await new Response(stream).arrayBuffer());
  const pixels = width * height;
  if (all.length !== 5 * pixels)
    throw new Error(`the picture has ${all.length} bytes, not ${5 * pixels}`);
  for (let row = 0; row < all.length; row += width) {
    for (let at = row + 1; at < row + width; at++) all[at] += all[at - 1];
  }
  const planes = [0, 1, 2, 3, 4].map((plane) => all.subarray(plane * pixels, (plane + 1) * pixels));
  return { width, height, planes };
}

/** The linear R, G, B of a pixel; NaN where it is not finite. */
export function rgb(picture, pixel) {
  const [r, g, b, exponents, signs] = picture.planes;
  if (exponents[pixel] === NOT_FINITE) return [Number.NaN, Number.NaN, Number.NaN];
  const unit = exponents[pixel] === 0 ? 0 : 2 ** (exponents[pixel] - 136);
  return [r, g, b].map((plane, channel) => {
    const size = plane[pixel] * unit;
    return (signs[pixel] >> channel) & 1 ? -size : size;
  });
}

// From linear radiance and from errors to the bytes of a screen.
import { NOT_FINITE, rgb } from "./codec.js";

/** Pixels that are not finite: magenta, which the false colours do not contain. */
const MAGENTA = [255, 0, 255];

/** The tone curves: linear radiance to linear light of the screen. */
export const CURVES = {
  srgb: { label: "sRGB", map: (x) => x },
  // Krzysztof Narkowicz's fit of the ACES curve, 2016.
  filmic: { label: "filmic", map: (x) => (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14) },
};

/** The byte of linear light, by the transfer function of sRGB (IEC 61966-2-1). */
function srgbByte(light) {
  const x = Math.min(Math.max(light, 0), 1);
  return Math.round(255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055));
}

/** For each exponent a table of the bytes of all magnitudes; exponents that occur in few pictures cost nothing. */
function toneTables(curve, stops) {
  const tables = [];
  return (exponent) => {
    const unit = exponent === 0 ? 0 : 2 ** (exponent - 136 + stops);
    tables[exponent] ??= Uint8Array.from({ length: 256 }, (_, size) =>
      srgbByte(curve.map(size * unit)),
    );
    return tables[exponent];
  };
}

/** A picture as it looks on a screen. */
export function paint(picture, curve, stops) {
  const image = new ImageData(picture.width, picture.height);
  const [r, g, b, exponents, signs] = picture.planes;
  const tableOf = toneTables(CURVES[curve], stops);
  for (let pixel = 0, at = 0; pixel < exponents.length; pixel++, at += 4) {
    if (exponents[pixel] === NOT_FINITE) {
      image.data.set(MAGENTA, at);
    } else {
      const table = tableOf(exponents[pixel]);
      const negative = signs[pixel];
      image.data[at] = negative & 1 ? 0 : table[r[pixel]];
      image.data[at + 1] = negative & 2 ? 0 : table[g[pixel]];
      image.data[at + 2] = negative & 4 ? 0 : table[b[pixel]];
    }
    image.data[at + 3] = 255;
  }
  return image;
}

/** The relative squared error of a pixel: the mean over its channels; NaN if it is not finite. */
export function pixelError(picture, reference, pixel, epsilon) {
  const [x, truth] = [rgb(picture, pixel), rgb(reference, pixel)];
  const parts = x.map(
    (value, channel) => (value - truth[channel]) ** 2 / (truth[channel] ** 2 + epsilon),
  );
  return (parts[0] + parts[1] + parts[2]) / 3;
}

/** The errors of a picture in false colours. `scale` is `{ low, high, epsilon, palette }`. */
export function paintErrors(picture, reference, scale) {
  const image = new ImageData(picture.width, picture.height);
  for (let pixel = 0, at = 0; at < image.data.length; pixel++, at += 4) {
    image.data.set(falseColor(pixelError(picture, reference, pixel, scale.epsilon), scale), at);
    image.data[at + 3] = 255;
  }
  return image;
}

/** The colour of an error: the palette from `low` to `high`, logarithmic. */
function falseColor(error, { low, high, palette }) {
  if (Number.isNaN(error)) return MAGENTA;
  const place =
    Math.min(Math.max(Math.log(error / low) / Math.log(high / low), 0), 1) * (palette.length - 1);
  const before = Math.min(Math.floor(place), palette.length - 2);
  const share = place - before;
  return palette[before].map((from, channel) =>
    Math.round(from + share * (palette[before + 1][channel] - from)),
  );
}

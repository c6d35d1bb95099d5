// The values of the chosen pixel.
import { rgb } from "./codec.js";
import { pixelError } from "./color.js";
import { REFERENCE } from "./comparer.js";
import { byId, element } from "./dom.js";
import { number } from "./format.js";

/** Shows the values of the chosen pixel in the pictures on both sides, and in the reference. */
export function showReadout(comparer) {
  const { left, right, pixel, spoken } = comparer.state;
  const ids = [...new Set([left, right, REFERENCE])].filter(Boolean);
  const rows = ids.map((id) => row(comparer, id, pixel));
  byId("place").textContent = pixel
    ? `Pixel (${pixel.x}, ${pixel.y}), linear values; from the left upper corner`
    : "No pixel is chosen: point at one, or go to the picture with Tab and press an arrow key.";
  byId("readout").tBodies[0].replaceChildren(
    ...rows.map(({ cells }) => {
      const [name, ...values] = cells;
      return element(
        "tr",
        {},
        element("th", { scope: "row" }, name),
        ...values.map((text) => element("td", {}, text)),
      );
    }),
  );
  // A screen reader would not come to an end if it said what lies under a moving pointer.
  if (pixel && spoken)
    byId("spoken").textContent =
      `Pixel ${pixel.x}, ${pixel.y}. ${rows.map((it) => it.sentence).join(" ")}`;
}

/** The cells of one picture, and what a screen reader says. */
function row(comparer, id, pixel) {
  const { name } = comparer.picture(id);
  const [pixels, reference] = [comparer.decoded.get(id), comparer.decoded.get(REFERENCE)];
  if (!pixel || !pixels || !reference) return { cells: [name, "", "", "", ""], sentence: "" };
  const at = pixel.y * comparer.size.width + pixel.x;
  const values = rgb(pixels, at);
  const finite = values.every(Number.isFinite);
  const texts = values.map((value) => (finite ? number(value) : "not finite"));
  const error = pixelError(pixels, reference, at, comparer.data.errors.epsilon);
  const cells = [name, ...texts, id === REFERENCE || Number.isNaN(error) ? "–" : number(error, 2)];
  return { cells, sentence: `${name}: ${finite ? texts.join(", ") : "not finite"}.` };
}

// The comparer: which pictures are shown, how, and their drawing on the canvas.
import { byId } from "./dom.js";
import { decode } from "./codec.js";
import { paint, paintErrors } from "./color.js";
import { fit } from "./view.js";

/** The names that the report gives to the reference and to the plain estimate. */
export const REFERENCE = "reference";

export class Comparer {
  /** Of the part `comparer` of the page's data. */
  constructor(data) {
    this.data = data;
    this.size = { width: data.width, height: data.height };
    this.canvas = byId("canvas");
    this.decoded = new Map();
    this.pending = new Map();
    this.painted = new Map();
    this.listeners = [];
    this.state = {
      spp: data.spp,
      left: data.left,
      right: data.right,
      split: 0.5,
      errors: false,
      curve: "srgb",
      stops: 0,
      view: null, // null: the whole picture
      pixel: null,
    };
  }

  /** Calls a function after every change of the state. */
  onChange(listener) {
    this.listeners.push(listener);
  }

  /** Changes parts of the state, and draws again. */
  set(changes) {
    Object.assign(this.state, changes);
    this.canvas.style.touchAction = this.state.view ? "none" : "pan-y";
    this.draw();
    for (const listener of this.listeners) listener(this.state);
  }

  /** The pictures that can be chosen: those of the chosen sample count, and those of none. */
  choices() {
    return this.data.pictures.filter(({ spp }) => spp === null || spp === this.state.spp);
  }

  /** Chooses a sample count; the methods stay where they have a picture of it. */
  setSpp(spp) {
    const { left, right } = this.state;
    this.state.spp = spp;
    const choices = this.choices();
    const like = (id) => {
      const method = this.picture(id)?.method;
      return choices.find((picture) => picture.method === method)?.id;
    };
    this.set({ left: like(left) ?? choices[0].id, right: right && (like(right) ?? null) });
  }

  picture(id) {
    return this.data.pictures.find((picture) => picture.id === id);
  }

  /** The pixels of a picture; undefined until they are decoded, which this begins. */
  pixels(id) {
    if (!this.decoded.has(id)) this.load(id).then(() => this.set({}), showFailure);
    return this.decoded.get(id);
  }

  load(id) {
    const { width, height } = this.size;
    const text = () => byId(`picture-${id}`).textContent;
    if (!this.pending.has(id)) {
      const begun = decode(text(), width, height).then((pixels) => this.decoded.set(id, pixels));
      this.pending.set(id, begun);
    }
    return this.pending.get(id);
  }

  /** Decodes all pictures one after the other, so that flipping does not wait. */
  async loadAll() {
    for (const { id } of this.data.pictures) await this.load(id);
  }

  /** The view, in pixels of the canvas. */
  view() {
    return this.state.view ?? fit(this.canvas, this.size);
  }

  /** Where the splitter is, in pixels of the canvas; nothing is right of it if there is one picture. */
  divide() {
    return this.state.right ? Math.round(this.state.split * this.canvas.width) : this.canvas.width;
  }

  draw() {
    const { canvas, state } = this;
    const context = canvas.getContext("2d");
    context.clearRect(0, 0, canvas.width, canvas.height);
    this.drawSide(context, state.left, 0, this.divide());
    if (state.right) this.drawSide(context, state.right, this.divide(), canvas.width);
    if (state.pixel) outline(context, this.view(), state.pixel);
    const ids = [state.left, state.right, REFERENCE].filter(Boolean);
    canvas.dataset.drawn = ids.every((id) => this.decoded.has(id)) ? "whole" : "partly";
  }

  drawSide(context, id, from, to) {
    const painted = this.paintedCanvas(id);
    if (!painted || to <= from) return;
    const { scale, left, top } = this.view();
    context.save();
    context.beginPath();
    context.rect(from, 0, to - from, this.canvas.height);
    context.clip();
    context.imageSmoothingEnabled = scale < 1;
    context.imageSmoothingQuality = "high";
    context.drawImage(painted, left, top, painted.width * scale, painted.height * scale);
    context.restore();
  }

  /** The whole picture as it looks with the chosen settings; undefined until it is decoded. */
  paintedCanvas(id) {
    const { errors, curve, stops } = this.state;
    const settings = errors ? "errors" : `${curve} ${stops}`;
    if (settings !== this.paintedWith) this.painted.clear();
    this.paintedWith = settings;
    const pixels = this.pixels(id);
    const reference = errors ? this.pixels(REFERENCE) : pixels;
    if (!pixels || !reference) return undefined;
    if (!this.painted.has(id)) {
      const image = errors
        ? paintErrors(pixels, reference, this.data.errors)
        : paint(pixels, curve, stops);
      const painted = new OffscreenCanvas(image.width, image.height);
      painted.getContext("2d").putImageData(image, 0, 0);
      this.painted.set(id, painted);
    }
    return this.painted.get(id);
  }
}

/** A frame around the chosen pixel, black and white, so that it is seen on any colour. */
function outline(context, { scale, left, top }, { x, y }) {
  const side = Math.max(scale, 6);
  const shift = (scale - side) / 2;
  for (const [color, grow] of [
    ["#000", 1.5],
    ["#fff", 0.5],
  ]) {
    context.strokeStyle = color;
    context.strokeRect(
      left + x * scale + shift - grow,
      top + y * scale + shift - grow,
      side + 2 * grow,
      side + 2 * grow,
    );
  }
}

function showFailure(error) {
  byId("failure").hidden = false;
  byId("failure").textContent = `A picture cannot be shown: ${error.message}`;
}

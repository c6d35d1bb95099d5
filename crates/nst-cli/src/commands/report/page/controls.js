// How users work the comparer: buttons, keys, wheel, pointer.
import { byId, checkRadio, element, fillRadios } from "./dom.js";
import { CURVES } from "./color.js";
import { stops } from "./format.js";
import { pan, pixelAt, reveal, zoomAt } from "./view.js";

/** The factor of a zoom by a key or a button. */
const STEP = 1.5;

/** Stops of exposure by a key. */
const HALF_STOP = 0.5;

/** Connects all controls with the comparer. */
export function connect(comparer) {
  const { state, canvas } = comparer;
  const options = (list, label) =>
    list.map((value) => ({ value: String(value), label: label(value) }));
  const { spps } = comparer.data;
  fillRadios(byId("spp"), options(spps, String), String(state.spp), (spp) =>
    comparer.setSpp(Number(spp)),
  );
  byId("spp").hidden = spps.length < 2;
  const modes = [
    { value: "picture", label: "picture" },
    { value: "errors", label: "error map" },
  ];
  fillRadios(byId("mode"), modes, "picture", (mode) => comparer.set({ errors: mode === "errors" }));
  const curves = options(Object.keys(CURVES), (name) => CURVES[name].label);
  fillRadios(byId("curve"), curves, state.curve, (curve) => comparer.set({ curve }));
  byId("exposure").addEventListener("input", (event) =>
    comparer.set({ stops: Number(event.target.value) }),
  );
  byId("other").addEventListener("change", (event) =>
    comparer.set({ right: event.target.value || null }),
  );
  comparer.onChange(() => show(comparer));
  document.addEventListener("keydown", (event) => pressed(event, comparer));
  connectPointer(canvas, comparer);
  connectSplitter(byId("splitter"), comparer);
  byId("zoom").addEventListener("click", ({ target }) => {
    if (target.value === "fit") comparer.set({ view: null });
    else if (target.value) zoomAtPixel(comparer, target.value === "in" ? STEP : 1 / STEP);
  });
  new ResizeObserver(() => resize(comparer)).observe(canvas);
}

/** Shows the state in the controls. */
function show(comparer) {
  const { state } = comparer;
  checkRadio(byId("spp"), String(state.spp));
  checkRadio(byId("mode"), state.errors ? "errors" : "picture");
  checkRadio(byId("curve"), state.curve);
  byId("exposure").value = state.stops;
  byId("exposure").setAttribute("aria-valuetext", stops(state.stops));
  byId("stops").textContent = stops(state.stops);
  showChoices(comparer);
  const splitter = byId("splitter");
  splitter.hidden = !state.right;
  splitter.style.left = `${100 * state.split}%`;
  splitter.setAttribute("aria-valuenow", Math.round(100 * state.split));
  byId("left-name").textContent = comparer.picture(state.left).name;
  byId("right-name").textContent = comparer.picture(state.right)?.name ?? "";
  byId("right-name").hidden = !state.right;
  byId("legend").hidden = !state.errors;
}

/** The buttons of the pictures, which change with the sample count. */
function showChoices(comparer) {
  const { state } = comparer;
  const choices = comparer.choices();
  const list = choices.map(({ id }) => id).join(" ");
  if (comparer.shownChoices !== list) {
    comparer.shownChoices = list;
    const key = (index) => (index < 9 ? String(index + 1) : "");
    const radios = choices.map(({ id, name }, index) => ({
      value: id,
      label: name,
      key: key(index),
    }));
    fillRadios(byId("pictures"), radios, state.left, (left) => comparer.set({ left }));
    const others = choices.map(({ id, name }) => element("option", { value: id }, name));
    byId("other").replaceChildren(element("option", { value: "" }, "nothing"), ...others);
  }
  checkRadio(byId("pictures"), state.left);
  byId("other").value = state.right ?? "";
}

/** Makes the canvas as fine as the screen. */
function resize(comparer) {
  const { canvas } = comparer;
  canvas.width = Math.max(1, Math.round(canvas.clientWidth * devicePixelRatio));
  canvas.height = Math.max(1, Math.round(canvas.clientHeight * devicePixelRatio));
  const { view } = comparer.state;
  comparer.set({ view: view && pan(view, 0, 0, canvas, comparer.size) });
}

/** Keys count while the focus is in the comparer, or nowhere. */
function pressed(event, comparer) {
  const { target } = event;
  const here = target === document.body || byId("comparer").contains(target);
  if (!here || target.tagName === "SELECT" || event.ctrlKey || event.metaKey || event.altKey)
    return;
  const digit = /^(?:Digit|Numpad)([1-9])$/.exec(event.code);
  const action = digit
    ? () => pick(comparer, Number(digit[1]) - 1, event.shiftKey)
    : actions(event, comparer)[event.key.toLowerCase()];
  if (!action) return;
  event.preventDefault();
  action();
}

function pick(comparer, index, onTheRight) {
  const choice = comparer.choices()[index];
  if (choice) comparer.set(onTheRight ? { right: choice.id } : { left: choice.id });
}

/** What each key does. */
function actions(event, comparer) {
  const { state } = comparer;
  const names = Object.keys(CURVES);
  const expose = (by) => () =>
    comparer.set({ stops: Math.min(Math.max(state.stops + by, -10), 10) });
  const zoom = (factor) => () => zoomAtPixel(comparer, factor);
  const general = {
    e: () => comparer.set({ errors: !state.errors }),
    s: () => toggleSplitter(comparer),
    t: () => comparer.set({ curve: names[(names.indexOf(state.curve) + 1) % names.length] }),
    ",": expose(-HALF_STOP),
    ".": expose(HALF_STOP),
    "+": zoom(STEP),
    "=": zoom(STEP),
    "-": zoom(1 / STEP),
    0: () => comparer.set({ view: null }),
  };
  if (event.target !== comparer.canvas) return general;
  const by = event.shiftKey ? 10 : 1;
  const step = (dx, dy) => () => stepPixel(comparer, dx * by, dy * by);
  return {
    ...general,
    arrowleft: step(-1, 0),
    arrowright: step(1, 0),
    arrowup: step(0, -1),
    arrowdown: step(0, 1),
  };
}

/** Switches the splitter off, and on again with the picture that was there. */
function toggleSplitter(comparer) {
  const { right } = comparer.state;
  if (right) comparer.lastRight = right;
  const last =
    comparer.choices().find(({ id }) => id === comparer.lastRight) ?? comparer.choices()[0];
  comparer.set({ right: right ? null : last.id });
}

/** Zooms around the chosen pixel, or the middle. */
function zoomAtPixel(comparer, factor) {
  const { canvas, size, state } = comparer;
  const view = comparer.view();
  const pixel = state.pixel ?? {
    x: (canvas.width / 2 - view.left) / view.scale,
    y: (canvas.height / 2 - view.top) / view.scale,
  };
  const [x, y] = [
    view.left + (pixel.x + 0.5) * view.scale,
    view.top + (pixel.y + 0.5) * view.scale,
  ];
  comparer.set({ view: zoomAt(view, x, y, factor, canvas, size) });
}

/** Chooses the pixel beside the chosen one, and brings it into view. */
function stepPixel(comparer, dx, dy) {
  const { width, height } = comparer.size;
  const { x, y } = comparer.state.pixel ?? {
    x: Math.floor(width / 2) - dx,
    y: Math.floor(height / 2) - dy,
  };
  const within = (at, length) => Math.min(Math.max(at, 0), length - 1);
  const pixel = { x: within(x + dx, width), y: within(y + dy, height) };
  const { view } = comparer.state;
  comparer.set({
    pixel,
    spoken: true,
    view: view && reveal(view, pixel, comparer.canvas, comparer.size),
  });
}

function connectPointer(canvas, comparer) {
  let last = null;
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top].map(
      (length) => length * devicePixelRatio,
    );
  };
  canvas.addEventListener("pointerdown", (event) => {
    last = place(event);
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    const [x, y] = place(event);
    const view = comparer.view();
    if (last && comparer.state.view) {
      comparer.set({ view: pan(view, x - last[0], y - last[1], canvas, comparer.size) });
    } else {
      comparer.set({ pixel: pixelAt(view, x, y, comparer.size), spoken: false });
    }
    if (last) last = [x, y];
  });
  for (const end of ["pointerup", "pointercancel"])
    canvas.addEventListener(end, () => {
      last = null;
    });
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 20 : 1;
      const view = zoomAt(
        comparer.view(),
        ...place(event),
        2 ** ((-event.deltaY * lines) / 200),
        canvas,
        comparer.size,
      );
      comparer.set({ view });
    },
    { passive: false },
  );
}

function connectSplitter(splitter, comparer) {
  const move = (split) => comparer.set({ split: Math.min(Math.max(split, 0), 1) });
  splitter.addEventListener("pointerdown", (event) => splitter.setPointerCapture(event.pointerId));
  splitter.addEventListener("pointermove", (event) => {
    if (!splitter.hasPointerCapture(event.pointerId)) return;
    const box = comparer.canvas.getBoundingClientRect();
    move((event.clientX - box.left) / box.width);
  });
  splitter.addEventListener("keydown", (event) => {
    const by = event.shiftKey ? 0.1 : 0.01;
    const places = { ArrowLeft: -by, ArrowRight: by, Home: -1, End: 1 };
    if (!(event.key in places)) return;
    event.preventDefault();
    move(comparer.state.split + places[event.key]);
  });
}

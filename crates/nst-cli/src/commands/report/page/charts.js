// Charts as pictures, and the values of their marks: under the pointer and by keyboard.
import { element } from "./dom.js";

/** The most marks with values: a pointer cannot tell more of them apart. */
const MOST_MARKS = 2000;

/** A figure of a chart `{ title, svg, marks: [[x, y, label]] }`; x and y are in the SVG's units. */
export function chartFigure({ title, svg, marks }) {
  const source = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(svg)}`;
  const [, , width, height] = /viewBox="([^"]*)"/.exec(svg)[1].split(" ").map(Number);
  const picture = element("img", { src: source, alt: title, width, height });
  const tip = element("p", { class: "tip", "aria-hidden": "true" });
  tip.hidden = true;
  const every = Math.ceil(marks.length / MOST_MARKS);
  const some = marks.filter((_, index) => index % every === 0);
  const buttons = some.map(([x, y, label]) => {
    const button = element("button", { type: "button", class: "mark", "aria-label": label });
    button.tabIndex = -1;
    button.style.left = `${(100 * x) / width}%`;
    button.style.top = `${(100 * y) / height}%`;
    return button;
  });
  const values = element("div", { role: "group", "aria-label": `Values: ${title}` }, ...buttons);
  connectMarks(values, buttons, tip);
  const frame = element("div", { class: "chart" }, picture, values, tip);
  return element("figure", {}, element("div", { class: "scroll" }, frame));
}

/** One of the marks is a stop of Tab; arrow keys go from it to the others. */
function connectMarks(values, buttons, tip) {
  if (buttons.length > 0) buttons[0].tabIndex = 0;
  const show = (index) => {
    tip.textContent = buttons[index].getAttribute("aria-label");
    tip.style.left = buttons[index].style.left;
    tip.style.top = buttons[index].style.top;
    tip.classList.toggle("leftwards", Number.parseFloat(tip.style.left) > 50);
    tip.hidden = false;
  };
  const hide = () => {
    tip.hidden = true;
  };
  buttons.forEach((button, index) => {
    for (const begin of ["pointerenter", "focus"])
      button.addEventListener(begin, () => show(index));
    for (const end of ["pointerleave", "blur"]) button.addEventListener(end, hide);
  });
  values.addEventListener("keydown", (event) => {
    const steps = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };
    const at = buttons.indexOf(event.target);
    if (event.key === "Escape") hide();
    if (!(event.key in steps) || at < 0) return;
    event.preventDefault();
    const next = buttons[(at + steps[event.key] + buttons.length) % buttons.length];
    buttons[at].tabIndex = -1;
    next.tabIndex = 0;
    next.focus();
  });
}

// Puts the data into the page.
import { chartFigure } from "./charts.js";
import { Comparer } from "./comparer.js";
import { connect } from "./controls.js";
import { byId, element } from "./dom.js";
import { number } from "./format.js";
import { showReadout } from "./readout.js";
import { fillTable } from "./table.js";

const data = JSON.parse(byId("data").textContent);

document.title = `${data.scene} – nst report`;
byId("scene").textContent = data.scene;
byId("headline").textContent = data.headline;
byId("advice").textContent = [...new Set(data.advice)].join(" ");
byId("charts").append(
  ...data.charts.map((chart, index) => {
    if (index === 0) return chartFigure(chart);
    return element("details", {}, element("summary", {}, chart.title), chartFigure(chart));
  }),
);
fillTable(byId("summaries"), data.columns, data.rows);

byId("failures").hidden = data.failures.length === 0;
byId("failures")
  .querySelector("ul")
  .append(...data.failures.map((text) => element("li", {}, text)));
for (const [name, value] of data.facts) {
  byId("facts")
    .querySelector("dl")
    .append(element("div", {}, element("dt", {}, name), element("dd", {}, value)));
}

byId("no-pictures").hidden = data.comparer !== null;
byId("no-pictures").textContent = data.no_pictures;
byId("with-pictures").hidden = data.comparer === null;
if (data.comparer) startComparer(new Comparer(data.comparer));

function startComparer(comparer) {
  const { low, high, epsilon, palette } = comparer.data.errors;
  byId("low").textContent = `≤ ${number(low)}`;
  byId("high").textContent = `≥ ${number(high)}`;
  byId("epsilon").textContent = number(epsilon);
  byId("scale").style.background =
    `linear-gradient(to right, ${palette.map((color) => `rgb(${color.join(" ")})`).join(", ")})`;
  byId("notes").append(...comparer.data.notes.map((text) => element("li", {}, text)));
  comparer.canvas.style.aspectRatio = `${comparer.size.width} / ${comparer.size.height}`;
  comparer.onChange(() => showReadout(comparer));
  connect(comparer);
  // Failures are shown where a picture is needed.
  comparer.loadAll().catch(() => {});
}

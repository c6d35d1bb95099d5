// The table of summaries, which sorts by the column whose name is clicked.
import { element } from "./dom.js";
import { number } from "./format.js";

/** The most rows that are shown at a time: browsers lay out some 10,000 cells quickly, but not millions. */
const MOST_ROWS = 1000;

/**
 * Fills a table. `columns` are `{ label, hint, text }`; `rows` are `{ cells, best }`, where
 * `best` lists the columns in which a row has the lowest error of those with as many samples.
 */
export function fillTable(table, columns, rows) {
  const order = { column: null, descending: false };
  const body = element("tbody");
  const heads = columns.map((column, index) => {
    const button = element("button", { type: "button", title: column.hint }, column.label);
    const head = element("th", { scope: "col", "aria-sort": "none" }, button);
    if (column.text) head.classList.add("text");
    button.addEventListener("click", () => {
      order.descending = order.column === index && !order.descending;
      order.column = index;
      heads.forEach((other, place) => {
        const sorted = order.descending ? "descending" : "ascending";
        other.setAttribute("aria-sort", place === index ? sorted : "none");
      });
      body.replaceChildren(...lines(sorted(rows, order), columns));
    });
    return head;
  });
  body.append(...lines(rows, columns));
  table.replaceChildren(element("thead", {}, element("tr", {}, ...heads)), body);
  if (rows.length > MOST_ROWS) {
    const rest = `The first ${MOST_ROWS} of ${rows.length} rows; sorting decides which these are.`;
    table.prepend(element("caption", {}, rest));
  }
}

/** Empty cells come last in both directions. */
function sorted(rows, { column, descending }) {
  const sign = descending ? -1 : 1;
  const compare = (a, b) =>
    typeof a === "string" ? a.localeCompare(b, "en", { numeric: true }) : a - b;
  return rows.toSorted((first, second) => {
    const [a, b] = [first.cells[column], second.cells[column]];
    if (a === null || b === null) return (a === null) - (b === null);
    return sign * compare(a, b);
  });
}

function lines(rows, columns) {
  return rows.slice(0, MOST_ROWS).map(({ cells, best }) => {
    const made = cells.map((value, index) =>
      cell(value, columns[index], index === 0, best.includes(index)),
    );
    return element("tr", {}, ...made);
  });
}

function cell(value, column, isHead, isBest) {
  const text =
    typeof value === "number" ? (column.whole ? String(value) : number(value)) : (value ?? "–");
  const made = isHead ? element("th", { scope: "row" }) : element("td");
  if (column.text) made.classList.add("text");
  made.append(isBest ? element("strong", {}, text) : text);
  return made;
}

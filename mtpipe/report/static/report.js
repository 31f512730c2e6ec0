// Draws the charts of the page, lets plateau and axis be chosen, and sorts tables.
"use strict";

const charts = JSON.parse(document.getElementById("charts").textContent);
const arrays = charts.arrays.map((packed) =>
  new Float32Array(Uint8Array.from(atob(packed), (c) => c.charCodeAt(0)).buffer));
const CONFIG = {
  responsive: true,
  displaylogo: false,
  modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
};
const PRINT_WIDTH_PX = 680; // A4 less its margins, at 96 px per inch
const PRINT_SHRINK = 0.8; // in height, so that two charts fit on a page

// A figure says {"array": i} where it means the page's i-th array.
function withArrays(part) {
  if (Array.isArray(part)) return part.map(withArrays);
  if (part === null || typeof part !== "object") return part;
  const keys = Object.keys(part);
  if (keys.length === 1 && typeof part.array === "number") return arrays[part.array];
  return Object.fromEntries(keys.map((key) => [key, withArrays(part[key])]));
}

function draw(place, figure) {
  const { data, layout } = withArrays(figure);
  place.dataset.height = layout.height;
  place.style.height = `${layout.height}px`;
  return Plotly.react(place, data, layout, CONFIG);
}

for (const place of document.querySelectorAll("[data-figure]")) {
  draw(place, charts.figures[place.dataset.figure]);
}

// --- choice of plateau and axis ---------------------------------------------------------------

const plateau = document.getElementById("plateau");

function show(key) {
  const [number, axis] = key.split("/");
  plateau.value = number;
  for (const radio of document.querySelectorAll("input[name=axis]")) {
    radio.checked = radio.value === axis;
  }
  for (const step of document.querySelectorAll("[data-step]")) {
    step.disabled = !plateau.options[plateau.selectedIndex + Number(step.dataset.step)];
  }
  for (const title of document.querySelectorAll(".chosen")) {
    title.textContent = `plateau ${number}, ${axis}`;
  }
  for (const place of document.querySelectorAll("[data-choice]")) {
    const figure = charts.choices[place.dataset.choice][key];
    if (figure) {
      draw(place, figure);
    } else {
      Plotly.purge(place);
      place.style.height = "";
    }
  }
  for (const caption of document.querySelectorAll("[data-caption]")) {
    const captions = charts.captions[key];
    caption.textContent = captions ? captions[caption.dataset.caption]
      : "This plateau has no such axis.";
  }
}

if (plateau && charts.first) {
  const chosen = () => `${plateau.value}/${document.querySelector("input[name=axis]:checked").value}`;
  plateau.addEventListener("change", () => show(chosen()));
  for (const radio of document.querySelectorAll("input[name=axis]")) {
    radio.addEventListener("change", () => show(chosen()));
  }
  for (const step of document.querySelectorAll("[data-step]")) {
    step.addEventListener("click", () => {
      plateau.selectedIndex += Number(step.dataset.step);
      show(chosen());
    });
  }
  for (const link of document.querySelectorAll("[data-key]")) {
    link.addEventListener("click", () => show(link.dataset.key));
  }
  show(charts.first);
}

// --- sorting ------------------------------------------------------------------------------------

const inOrder = new Intl.Collator(undefined, { numeric: true }).compare;

// Rows without a value stay at the end in both directions.
function compare(a, b, direction) {
  if (a === null || b === null) return (a === null) - (b === null);
  const order = typeof a === "number" && typeof b === "number" ? a - b : inOrder(a, b);
  return order * direction;
}

function sortKey(row, column) {
  const cell = row.cells[column];
  if (cell.dataset.sort !== undefined) return Number(cell.dataset.sort);
  return cell.querySelector(".hidden") ? null : cell.textContent.trim();
}

for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => head.querySelector("button")?.addEventListener("click", () => {
    const up = head.getAttribute("aria-sort") !== "ascending";
    for (const other of heads) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    const keyed = [...table.tBodies[0].rows].map((row) => [sortKey(row, column), row]);
    keyed.sort(([a], [b]) => compare(a, b, up ? 1 : -1));
    table.tBodies[0].append(...keyed.map(([, row]) => row));
  }));
}

// --- printing: charts as wide as the paper; what is folded is opened, but for long lists ----------

let opened = [];
const drawn = () => document.querySelectorAll(".js-plotly-plot");

// The element gets the size as well: plotly reads it there when the browser resizes the page.
function resize(place, width, shrink) {
  const height = Math.round(shrink * place.dataset.height);
  place.style.width = width === null ? "" : `${width}px`;
  place.style.height = `${height}px`;
  Plotly.relayout(place, { width, height, autosize: width === null });
}

window.addEventListener("beforeprint", () => {
  opened = [...document.querySelectorAll("details:not([open], .screen)")];
  for (const details of opened) details.open = true;
  for (const place of drawn()) resize(place, PRINT_WIDTH_PX, PRINT_SHRINK);
});
window.addEventListener("afterprint", () => {
  for (const details of opened) details.open = false;
  for (const place of drawn()) resize(place, null, 1);
});

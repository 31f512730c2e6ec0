// Sorts tables, shows the beads that are searched for, and lets wide tables be scrolled by keys.
"use strict";

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

// --- a table as a file: what it shows, separated by commas ------------------------------------------

function asCsv(table) {
  // a spreadsheet takes a cell that begins so for a formula
  const harmless = (text) => (/^[=+\-@\t\r]/.test(text) ? `'${text}` : text);
  const cell = ({ innerText }) => `"${harmless(innerText.trim().replace(/\s+/g, " ")).replaceAll('"', '""')}"`;
  return [...table.rows].map((row) => [...row.cells].map(cell).join(",")).join("\n");
}

for (const table of document.querySelectorAll(".scroll > table")) {
  const button = document.createElement("button");
  button.type = "button";
  button.className = "save";
  button.textContent = "Save as CSV";
  const title = table.closest("section, details")?.querySelector("h2, h3, summary")?.textContent;
  const name = (title ?? "table").trim().toLowerCase().replace(/[^a-z0-9]+/g, "-");
  button.addEventListener("click", () => offer(`${name}.csv`, asCsv(table), "text/csv"));
  table.parentElement.after(button);
}

// --- search: a bead is shown if its verdict is chosen and its finding has every word ---------------

const search = document.getElementById("search");

function filter() {
  const sought = search.value.toLowerCase().split(/\s+/).filter(Boolean);
  const verdicts = new Set(
    [...document.querySelectorAll("input[name=verdict]:checked")].map((box) => box.value));
  const articles = [...document.querySelectorAll("article[data-bead]")];
  const kept = new Set(articles.filter((article) => {
    const text = article.textContent.toLowerCase();
    return verdicts.has(article.dataset.verdict) && sought.every((word) => text.includes(word));
  }).map((article) => article.dataset.bead));
  for (const one of document.querySelectorAll("[data-bead]")) {
    one.hidden = !kept.has(one.dataset.bead);
  }
  document.getElementById("shown").textContent =
    kept.size === articles.length ? "" : `${kept.size} of ${articles.length} beads shown`;
}

if (search) {
  const form = search.closest("form");
  form.addEventListener("input", filter);
  form.addEventListener("submit", (event) => event.preventDefault());
  filter(); // a browser may have kept what was typed
}

// --- a region is a stop of the tab key only where there is something to scroll --------------------

const wide = new ResizeObserver((entries) => {
  for (const { target } of entries) {
    if (target.scrollWidth > target.clientWidth) target.tabIndex = 0;
    else target.removeAttribute("tabindex");
  }
});
for (const region of document.querySelectorAll(".scroll")) wide.observe(region);

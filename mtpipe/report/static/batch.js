// Shows the rows that have every word searched for, and one of the verdicts and states chosen.
"use strict";

const rows = [...document.querySelectorAll("tbody tr")].map((row) => [row, row.textContent.toLowerCase()]);
const form = document.getElementById("filter");

function chosen(name) {
  return new Set([...form.elements].filter((box) => box.name === name && box.checked).map((box) => box.value));
}

function show() {
  const sought = form.elements.words.value.toLowerCase().split(/\s+/).filter(Boolean);
  const verdicts = chosen("verdict");
  const states = chosen("status");
  let shown = 0;
  for (const [row, text] of rows) {
    row.hidden = !(verdicts.has(row.dataset.verdict) && states.has(row.dataset.status) &&
      sought.every((word) => text.includes(word)));
    shown += !row.hidden;
  }
  document.getElementById("count").textContent = shown === rows.length ? "" : `${shown} of ${rows.length} rows shown`;
}

form.addEventListener("input", show);
form.addEventListener("submit", (event) => event.preventDefault());
show(); // a browser may have kept what was typed

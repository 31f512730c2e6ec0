// Draws every figure of a page of the report as SVG, and leaves nothing but those in the page.
"use strict";

async function exportAll() {
  const made = {};
  for (const [name, figure] of Object.entries(charts.figures)) {
    made[name] = await asSvg(light(figure));
  }
  for (const [kind, figures] of Object.entries(charts.choices ?? {})) {
    for (const [trace, figure] of Object.entries(figures)) {
      made[`${kind}-${trace.replace("/", "-")}`] = await asSvg(light(figure));
    }
  }
  return made;
}

window.addEventListener("load", () => exportAll().then((made) => {
  document.body.textContent = JSON.stringify(made);
  document.body.dataset.done = "yes";
}));

// Draws the charts of the page in the colours of the screen, and lets plateau and axis be chosen.
"use strict";

const charts = JSON.parse(document.getElementById("charts").textContent);
const arrays = charts.arrays.map((packed) =>
  new Float32Array(Uint8Array.from(atob(packed), (c) => c.charCodeAt(0)).buffer));
const CONFIG = {
  responsive: true,
  displaylogo: false,
  modeBarButtonsToRemove: ["toImage", "select2d", "lasso2d", "autoScale2d"],
};
const PRINT_WIDTH_PX = 680; // A4 less its margins, at 96 px per inch
const PRINT_PICTURE_PX = 320; // the picture of a finding, beside its words
const PRINT_SHRINK = 0.8; // in height, so that two charts fit on a page

const SAVE = {
  name: "save", title: "Save as SVG, as for print", icon: Plotly.Icons.camera,
  click: (place) => asSvg(light(shown.get(place))).then((svg) =>
    offer(`${place.dataset.figure ?? place.dataset.choice}.svg`, svg, "image/svg+xml")),
};
CONFIG.modeBarButtonsToAdd = [SAVE];

const PLAIN = { ...CONFIG, displayModeBar: false };
const night = window.matchMedia("(prefers-color-scheme: dark)");
let printing = false;

// A figure says {"array": i} where it means the page's i-th array, and has the colours of a light
// page; on a dark screen those of charts.dark stand in their place.
function resolved(part) {
  if (Array.isArray(part)) return part.map(resolved);
  if (typeof part === "string") return (night.matches && !printing && charts.dark[part]) || part;
  if (part === null || typeof part !== "object") return part;
  const keys = Object.keys(part);
  if (keys.length === 1 && typeof part.array === "number") return arrays[part.array];
  return Object.fromEntries(keys.map((key) => [key, resolved(part[key])]));
}

// A figure in the colours of paper, whatever the screen has.
function light(figure) {
  const before = printing;
  printing = true;
  const found = resolved(figure);
  printing = before;
  return found;
}

// What each place shows, to be drawn again when the colours change.
const shown = new Map();

function draw(place, figure) {
  shown.set(place, figure);
  // on paper charts are smaller, and so is their type: labels of neighbouring lines would overlap
  const { data, layout } = printing ? smallType(resolved(figure)) : resolved(figure);
  place.dataset.height = layout.height;
  place.style.height = `${layout.height}px`;
  Plotly.react(place, data, layout, "plain" in place.dataset ? PLAIN : CONFIG).then(() => {
    // the mouse reaches these buttons; with the keyboard they would be six stops in every chart
    for (const button of place.querySelectorAll(".modebar-btn")) button.tabIndex = -1;
  });
}

const drawAgain = () => shown.forEach((figure, place) => draw(place, figure));

// A chart is drawn when it is about to be seen: a recording may have a hundred beads.
const coming = new IntersectionObserver((entries) => {
  for (const { isIntersecting, target } of entries) {
    if (isIntersecting) drawFirst(target);
  }
}, { rootMargin: "400px" });

function drawFirst(place) {
  coming.unobserve(place);
  if (!shown.has(place)) draw(place, charts.figures[place.dataset.figure]);
}

const places = document.querySelectorAll("[data-figure]");
for (const place of places) {
  // its room is there before it is drawn, so that the page does not jump
  place.style.height = `${charts.figures[place.dataset.figure].layout.height}px`;
  coming.observe(place);
}
night.addEventListener("change", drawAgain);

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
      shown.delete(place);
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

// --- printing: dark on white and as wide as the paper; what is folded is opened, but for long lists

let opened = [];

// The element gets the size as well: plotly reads it there when the browser resizes the page.
function resize(place, width, shrink) {
  const height = Math.round(shrink * place.dataset.height);
  place.style.width = width === null ? "" : `${width}px`;
  place.style.height = `${height}px`;
  // margins shrink with the rest, or they would take all of it from what is drawn
  const margin = Object.fromEntries(Object.entries(shown.get(place).layout.margin)
    .map(([side, px]) => [side, Math.round(shrink * px)]));
  Plotly.relayout(place, { width, height, margin, autosize: width === null });
}

window.addEventListener("beforeprint", () => {
  printing = true;
  opened = [...document.querySelectorAll("details:not([open], .screen)")];
  for (const details of opened) details.open = true;
  places.forEach(drawFirst);
  drawAgain();
  for (const place of shown.keys()) {
    const plain = "plain" in place.dataset;
    resize(place, plain ? PRINT_PICTURE_PX : PRINT_WIDTH_PX, plain ? 1 : PRINT_SHRINK);
  }
});
window.addEventListener("afterprint", () => {
  printing = false;
  for (const details of opened) details.open = false;
  drawAgain();
  for (const place of shown.keys()) resize(place, null, 1);
});

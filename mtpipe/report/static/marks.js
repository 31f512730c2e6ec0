// What the reader leaves out by hand, gathered on the page and saved as marks.toml.
"use strict";

const form = document.getElementById("mark");
const known = JSON.parse(form.dataset.known);
const { bead, plateau: numbered, begin, end, reason } = form.elements;
let marks = known.marks;

function option(value, text) {
  const made = document.createElement("option");
  made.value = value;
  made.textContent = text;
  return made;
}

function offerPlateaus() {
  numbered.replaceChildren(option("", "the whole bead"), option("stretch", "a stretch of time"),
    ...known.beads[bead.value].map((number) => option(number, `plateau ${number}`)));
  offerTimes();
}

function offerTimes() {
  for (const field of [begin, end]) {
    field.required = numbered.value === "stretch";
    field.closest("label").hidden = !field.required;
  }
}

function place(mark) {
  if (mark.from_s !== null) return `${mark.bead}, ${mark.from_s} to ${mark.to_s} s`;
  return mark.plateau === null ? mark.bead : `${mark.bead}, plateau ${mark.plateau}`;
}

function list() {
  document.getElementById("marked").replaceChildren(...marks.map((mark) => {
    const item = document.createElement("li");
    const button = document.createElement("button");
    button.type = "button";
    button.className = "save";
    button.textContent = "Take back";
    button.addEventListener("click", () => {
      marks = marks.filter((one) => one !== mark);
      list();
    });
    item.append(`${place(mark)}: ${mark.reason} `, button);
    return item;
  }));
}

// A float in TOML has a point.
const written = (key, value) =>
  `${key} = ${key.endsWith("_s") && Number.isInteger(value) ? value.toFixed(1) : JSON.stringify(value)}`;

function asToml() {
  const tables = marks.map((mark) => ["[[mark]]", ...Object.entries(mark)
    .filter(([, value]) => value !== null).map(([key, value]) => written(key, value)), ""].join("\n"));
  return [`${known.head}schema = 1\n`, ...tables].join("\n");
}

bead.append(...Object.keys(known.beads).map((name) => option(name, name)));
bead.addEventListener("change", offerPlateaus);
numbered.addEventListener("change", offerTimes);
form.addEventListener("submit", (event) => {
  event.preventDefault();
  const stretch = numbered.value === "stretch";
  const mark = {
    bead: bead.value,
    reason: reason.value.trim(),
    plateau: stretch || numbered.value === "" ? null : Number(numbered.value),
    from_s: stretch ? Number(begin.value) : null,
    to_s: stretch ? Number(end.value) : null,
  };
  end.setCustomValidity(stretch && mark.from_s >= mark.to_s ? "after the begin" : "");
  if (!form.reportValidity()) return;
  marks = [...marks.filter((one) => place(one) !== place(mark)), mark];
  reason.value = "";
  list();
});
end.addEventListener("input", () => end.setCustomValidity(""));
document.getElementById("save-marks").addEventListener("click", () =>
  offer("marks.toml", asToml(), "application/toml"));
offerPlateaus();
list();

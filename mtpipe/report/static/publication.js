// Figures as papers print them: one or two columns wide, type of 8 points, on white, as SVG.
"use strict";

const PX_PER_MM = 96 / 25.4;
const COLUMN_MM = 89, PAGE_MM = 183; // of most journals
const TYPE_PX = 8 / 72 * 96;
const LEGEND_PX = 10; // of each line of a legend, which a column holds two of
const PANEL = /^xaxis\d+$/;

// A figure by itself: {data, layout}, with its size in layout.
function publication({ data, layout }) {
  const panels = Object.keys(layout).some((key) => PANEL.test(key));
  const wide = panels || data.some((trace) => trace.type === "heatmap");
  const width = Math.round((wide ? PAGE_MM : COLUMN_MM) * PX_PER_MM);
  const named = data.filter((trace) => trace.name && trace.showlegend !== false).length;
  const shape = layout.yaxis2 ? 1.1 : 0.8; // two panels above one another, or one
  const height = Math.round(wide ? 0.85 * layout.height
    : shape * width + (layout.showlegend === false ? 0 : LEGEND_PX * named));
  const margin = { ...layout.margin, r: 8 };
  return {
    data: smallType(data),
    layout: {
      ...smallType(layout), width, height, autosize: false, margin,
      font: { ...layout.font, family: "Arial, Helvetica, sans-serif", size: TYPE_PX },
    },
  };
}

// Sizes of type inside a part of a figure, all alike.
function smallType(part) {
  if (Array.isArray(part)) return part.map(smallType);
  if (part === null || typeof part !== "object" || ArrayBuffer.isView(part)) return part;
  const small = ([key, value]) => {
    if (key === "font" || key === "tickfont") return [key, { ...value, size: TYPE_PX }];
    if (key !== "title") return [key, smallType(value)];
    return [key, { ...value, font: { ...value.font, size: TYPE_PX } }];
  };
  return Object.fromEntries(Object.entries(part).map(small));
}

async function asSvg(figure) {
  const made = publication(figure);
  const { width, height } = made.layout;
  return Plotly.toImage(made, { format: "svg", width, height, imageDataOnly: true });
}

// Let the reader save a file that was made here.
function offer(name, content, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

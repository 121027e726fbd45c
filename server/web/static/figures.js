// Draws figures that the coordinator describes, in the page's own ink, and hands them out as files.

import { onFigure } from "./live.js";
import { save } from "./files.js";

const dark = matchMedia("(prefers-color-scheme: dark)");
const drawn = new Map();
const PLOTLY = new URL("plotly.min.js", import.meta.url).href;
let library = null;

/** Loads plotly.js after the page's first paint: to read its megabytes takes longer than all else. */
function plotly() {
  library ??= new Promise((resolve, reject) => {
    requestAnimationFrame(() => setTimeout(() => {
      const script = Object.assign(document.createElement("script"), { src: PLOTLY });
      script.addEventListener("load", resolve);
      script.addEventListener("error", () => {
        library = null;
        reject(new Error("The coordinator does not answer."));
      });
      document.head.append(script);
    }));
  });
  return library;
}

const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

// Where there is less room, panels stand below each other.
const NARROW = 700; // pixels

/** Returns a figure's layout in the colours of the page, which has a heading for it of its own. */
function inked({ title, ...layout }) {
  const axis = { gridcolor: style("--line"), zerolinecolor: style("--faint"), linecolor: style("--faint") };
  const names = Object.keys(layout).filter((name) => /^[xy]axis\d*$/.test(name));
  const axes = Object.fromEntries(names.map((name) => [name, { ...axis, ...layout[name] }]));
  const shapes = (layout.shapes ?? []).map((shape) => ({
    ...shape,
    line: { color: style("--faint"), ...shape.line },
  }));
  const hover = { bgcolor: style("--ink"), font: { color: style("--paper") }, ...layout.hoverlabel };
  return {
    ...layout,
    ...axes,
    ...stacked(layout),
    shapes,
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    font: { color: style("--ink"), family: "system-ui, sans-serif", size: innerWidth < 500 ? 11 : 13 },
    hoverlabel: hover,
    // No "transition": with one, plotly.js leaves axes as they were under data that have grown.
    // The reader's own zoom stays for as long as the axes are of the same quantities.
    uirevision: names.map((name) => layout[name].title?.text).join(),
  };
}

function stacked({ grid, height }) {
  if (!grid || grid.columns === 1 || innerWidth >= NARROW) return {};
  const rows = grid.rows * grid.columns;
  return { height: height * grid.columns, grid: { ...grid, rows, columns: 1, ygap: 0.25 } };
}

/** Returns traces whose black lines and error bars are as the page's ink is. */
function visible(traces) {
  const shown = JSON.parse(JSON.stringify(traces).replaceAll("#000000", style("--ink")));
  for (const { error_x: bars } of shown) if (bars) bars.color ??= style("--ink");
  return shown;
}

/** Draws a figure into its box; hides the box where there is nothing to draw. */
export async function draw(name, figure) {
  const box = document.querySelector(`[data-figure="${CSS.escape(name)}"]`);
  if (!box) return;
  box.closest("figure").hidden = !figure;
  drawn.set(name, figure);
  if (!figure) return;
  // What is below stays where it is when the figure comes.
  box.style.minHeight = `${{ ...figure.layout, ...stacked(figure.layout) }.height}px`;
  try {
    await plotly();
  } catch {
    return; // The banner says why; the next figure tries again.
  }
  // A newer one has come meanwhile.
  if (drawn.get(name) !== figure) return;
  const width = box.clientWidth;
  const layout = inked({ ...figure.layout, ...(width ? { width } : {}) });
  Plotly.react(box, visible(figure.data), layout, { displayModeBar: false }).then(() => {
    if (box.dataset.ready) return;
    box.dataset.ready = "yes";
    for (const event of ["plotly_hover", "plotly_click"]) {
      box.on(event, ({ points }) => {
        const factor = [points[0].customdata].flat()[0];
        const detail = { factor, pinned: event === "plotly_click" };
        if (typeof factor === "string") box.dispatchEvent(new CustomEvent("factor", { detail, bubbles: true }));
      });
    }
  });
}

function redraw() {
  for (const [name, figure] of drawn) draw(name, figure);
}

function cell(value) {
  const text = value === null || value === undefined ? "" : `${value}`;
  return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

function csv({ head, rows }) {
  return [head, ...rows].map((row) => row.map(cell).join(",")).join("\r\n") + "\r\n";
}

async function keep(button) {
  const box = button.closest("figure").querySelector("[data-figure]");
  const name = box.dataset.figure;
  const file = `${location.pathname.split("/").at(-1)}-${name}.${button.dataset.keep}`;
  if (button.dataset.keep === "csv") {
    save(file, new Blob([csv(drawn.get(name).table)], { type: "text/csv" }));
    return;
  }
  const paper = { paper_bgcolor: "#ffffff", font: { color: "#1c2430", family: "sans-serif", size: 13 } };
  const { data, layout } = drawn.get(name);
  const [width, height] = [box.clientWidth, box.clientHeight];
  // plotly.js writes into what it draws.
  const margin = { ...layout.margin, t: 70 };
  const figure = structuredClone({ data, layout: { ...layout, ...paper, margin } });
  const uri = await Plotly.toImage(figure, { format: button.dataset.keep, width, height, scale: 2 });
  save(file, await blob(uri));
}

/** Returns what a data: address holds; nothing is asked of anybody. */
function blob(uri) {
  const [head, body] = [uri.slice(5, uri.indexOf(",")), uri.slice(uri.indexOf(",") + 1)];
  const bytes = head.endsWith("base64")
    ? Uint8Array.from(atob(body), (letter) => letter.charCodeAt(0))
    : new TextEncoder().encode(decodeURIComponent(body));
  return new Blob([bytes], { type: head.split(";")[0] });
}

document.addEventListener("click", (event) => {
  const button = event.target.closest("button[data-keep]");
  if (button) keep(button);
});
dark.addEventListener("change", redraw);
let soon = 0;
addEventListener("resize", () => {
  clearTimeout(soon);
  soon = setTimeout(redraw, 150);
});
onFigure((name, figure) => {
  if (name !== "sample") draw(name, figure);
});

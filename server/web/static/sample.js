// Shows runs of a study by the factor that the pointer touches: the output over it, the output's
// distribution, and it beside another factor.

import { draw } from "./figures.js";
import { onFigure } from "./live.js";

const section = document.getElementById("sample");
const [factor, other] = ["factor", "other"].map((id) => document.getElementById(id));
const words = (name) => name.replaceAll("_", " ");
const GLOW = "#ff5a1f";
let runs = null;
let seen = "";

onFigure(async (name, figure) => {
  if (name !== "sample" || seen === `${figure.version}`) return;
  seen = `${figure.version}`;
  const answer = await fetch(`${location.pathname}/sample?output=${encodeURIComponent(figure.output)}`);
  if (!answer.ok) return;
  runs = await answer.json();
  section.hidden = !runs.rows;
  if (!runs.rows) return;
  const chosen = new URLSearchParams(location.search).get("factor");
  for (const [place, list] of [factor, other].entries()) {
    const before = list.value || (place ? runs.factors.at(1) : chosen) || runs.factors[0];
    list.replaceChildren(...runs.factors.map((one) => new Option(words(one), one)));
    list.value = runs.factors.includes(before) ? before : runs.factors[0];
  }
  document.getElementById("sampled").textContent =
    `The first runs of ${runs.rows.toLocaleString()} of ${runs.of.toLocaleString()} rows, ` +
    "which fill the space of the factors evenly. Runs that failed glow.";
  show();
});

/** Parts the runs into those that came to something and those that failed. */
function parted() {
  const all = runs.outcomes.map((_, place) => place);
  return [
    all.filter((place) => runs.columns[runs.output][place] !== null),
    all.filter((place) => runs.outcomes[place] !== "ok"),
  ];
}

const at = (name, places) => places.map((place) => runs.columns[name][place]);
const axis = (name) => ({ title: { text: words(name) }, automargin: true });

function layout(x, y, more = {}) {
  return { height: 320, margin: { l: 10, r: 10, t: 8, b: 44 }, showlegend: false, xaxis: x, yaxis: y, ...more };
}

function cloud(x, y, places, marker, text) {
  const hovertext = places.map((place) => `row ${runs.row[place]}: ${text(place)}`);
  return {
    type: "scatter", mode: "markers", x: at(x, places), y: typeof y === "string" ? at(y, places) : places.map(() => y),
    marker, hovertext, hovertemplate: "%{hovertext}<extra></extra>",
  };
}

function show() {
  if (!runs?.rows) return;
  const [x, y, z] = [factor.value, runs.output, other.value];
  const [good, bad] = parted();
  const say = (place) => `${words(x)} ${runs.columns[x][place]}, ${words(y)} ${runs.columns[y][place] ?? runs.outcomes[place]}`;
  const values = at(y, good);
  const floor = values.length ? Math.min(...values) : 0;
  const head = ["row", "outcome", ...runs.factors, y];
  const rows = runs.row.map((row, place) => [row, runs.outcomes[place], ...[...runs.factors, y].map((n) => runs.columns[n][place])]);
  const table = { head, rows };
  const glow = { size: 9, color: GLOW, symbol: "x", line: { width: 1, color: "#ffffff" } };
  draw("scatter", {
    data: [cloud(x, y, good, { size: 5, opacity: 0.65, color: "#0072B2" }, say), cloud(x, floor, bad, glow, say)],
    layout: layout(axis(x), axis(y)),
    table,
  });
  draw("distribution", {
    data: [{ type: "histogram", x: values, marker: { color: "#0072B2" }, nbinsx: 40, hovertemplate: "%{x}: %{y} runs<extra></extra>" }],
    layout: layout(axis(y), { title: { text: "runs" }, automargin: true }, { bargap: 0.03 }),
    table,
  });
  const scale = { size: 6, color: values, colorscale: "Viridis", showscale: true, colorbar: { thickness: 10 } };
  draw("pair", {
    data: [cloud(x, z, good, scale, say), cloud(x, z, bad, glow, say)],
    layout: layout(axis(x), axis(z)),
    table,
  });
}

function choose(name, pinned) {
  if (!runs?.factors.includes(name)) return;
  if (factor.value !== name) {
    if (other.value === name) other.value = factor.value;
    factor.value = name;
    show();
  }
  if (pinned) remember();
}

function remember() {
  const url = new URL(location);
  url.searchParams.set("factor", factor.value);
  history.replaceState(null, "", url);
}

document.addEventListener("factor", ({ detail }) => choose(detail.factor, detail.pinned));
for (const list of [factor, other]) {
  list.addEventListener("change", () => {
    remember();
    show();
  });
}

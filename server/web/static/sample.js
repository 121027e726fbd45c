// Shows runs of a study by the factor that the pointer touches: the output over it, the output's
// distribution, it beside another factor, and all factors at once. The coordinator describes them.

import { draw } from "./figures.js";
import { onFigure } from "./live.js";

const section = document.getElementById("sample");
const [factor, other] = ["factor", "other"].map((id) => document.getElementById(id));
const words = (name) => name.replaceAll("_", " ");
let output = "";
let seen = "";
let answers = new Map();

onFigure((name, figure) => {
  if (name !== "sample" || seen === `${figure.version}`) return;
  seen = `${figure.version}`;
  output = figure.output;
  answers = new Map();
  show(factor.value || new URLSearchParams(location.search).get("factor") || "", other.value);
});

/** Returns what is drawn of two factors; each is asked for once. */
function asked(one, two) {
  const query = new URLSearchParams({ output, factor: one, other: two });
  const key = `${query}`;
  if (!answers.has(key)) {
    const found = fetch(`${location.pathname}/sample?${query}`).then((answer) => (answer.ok ? answer.json() : null));
    answers.set(key, found.catch(() => null));
  }
  return answers.get(key);
}

let latest = 0;
async function show(one, two) {
  const turn = ++latest;
  const runs = await asked(one, two);
  // Another has been touched meanwhile.
  if (!runs || turn !== latest) return;
  section.hidden = !runs.rows;
  if (!runs.rows) return;
  for (const [list, chosen] of [[factor, runs.factor], [other, runs.other]]) {
    list.replaceChildren(...runs.factors.map((name) => new Option(words(name), name)));
    list.value = chosen;
  }
  document.getElementById("sampled").textContent =
    `The first runs of ${runs.rows.toLocaleString()} of ${runs.of.toLocaleString()} rows, ` +
    "which fill the space of the factors evenly. Runs that failed glow.";
  for (const [name, figure] of Object.entries(runs.figures)) draw(name, { ...figure, table: runs.table });
}

function remember() {
  const url = new URL(location);
  url.searchParams.set("factor", factor.value);
  history.replaceState(null, "", url);
}

document.addEventListener("factor", async ({ detail }) => {
  const known = [...factor.options].some((option) => option.value === detail.factor);
  if (known && factor.value !== detail.factor) {
    await show(detail.factor, other.value === detail.factor ? factor.value : other.value);
  }
  if (known && detail.pinned) remember();
});
for (const list of [factor, other]) {
  list.addEventListener("change", () => {
    remember();
    show(factor.value, other.value);
  });
}

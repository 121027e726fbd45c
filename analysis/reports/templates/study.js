// Shows values at the pointer, marks the same run in every panel, and sorts tables.
// Figures are images; data-panels says where their panels lie (analysis/reports/hover.py).
"use strict";

const NEAR = 16; // pixels

const tip = document.createElement("div");
tip.id = "tip";
tip.hidden = true;
document.body.append(tip);

const words = (name) => name.replaceAll("_", " ");

/** Returns [left, top] of a point of a panel in pixels of a plot, or null if it lies outside. */
function place(panel, size, x, y) {
  const scale = panel.log ? Math.log2 : Number;
  const [left, top, right, bottom] = panel.box;
  const u = (scale(x) - scale(panel.x[0])) / (scale(panel.x[1]) - scale(panel.x[0]));
  const v = (y - panel.y[0]) / (panel.y[1] - panel.y[0]);
  if (!(u >= 0 && u <= 1 && v >= 0 && v <= 1)) return null;
  return [(left + u * (right - left)) * size.width, (bottom - v * (bottom - top)) * size.height];
}

/** Returns what a panel shows: [x, y, text or number of the run]. */
function* points(panel, table) {
  if (panel.marks) yield* panel.marks;
  if (!panel.runs || !table) return;
  const [i, j] = panel.runs.map((name) => table.columns.indexOf(name));
  for (const [k, run] of table.runs.entries()) yield [run[i], run[j], k];
}

function tell(table, k) {
  const cells = table.columns.map((name, c) => `${words(name)} ${table.runs[k][c]}`);
  return `row ${table.runs[k][0]}, position ${table.runs[k][1]}\n` + cells.slice(2).join("\n");
}

function ring(plot, at) {
  const mark = document.createElement("i");
  mark.className = "ring";
  mark.style.left = `${at[0]}px`;
  mark.style.top = `${at[1]}px`;
  plot.append(mark);
}

function clear() {
  tip.hidden = true;
  for (const mark of document.querySelectorAll(".ring")) mark.remove();
}

for (const section of document.querySelectorAll("section")) {
  const data = section.querySelector("script.runs");
  const table = data ? JSON.parse(data.textContent) : null;
  const plots = [...section.querySelectorAll("[data-panels]")].map((plot) => ({
    plot,
    panels: JSON.parse(plot.dataset.panels),
  }));
  for (const { plot, panels } of plots) {
    plot.addEventListener("pointermove", (event) => {
      clear();
      const size = plot.getBoundingClientRect();
      let best = NEAR;
      let found = null;
      for (const panel of panels) {
        for (const [x, y, what] of points(panel, table)) {
          const at = place(panel, size, x, y);
          if (!at) continue;
          const off = Math.hypot(size.left + at[0] - event.clientX, size.top + at[1] - event.clientY);
          if (off < best) [best, found] = [off, { at, what }];
        }
      }
      if (!found) return;
      if (typeof found.what === "number") {
        tip.textContent = tell(table, found.what);
        for (const other of plots) {
          for (const panel of other.panels.filter((one) => one.runs)) {
            const [x, y] = panel.runs.map((n) => table.runs[found.what][table.columns.indexOf(n)]);
            const at = place(panel, other.plot.getBoundingClientRect(), x, y);
            if (at) ring(other.plot, at);
          }
        }
      } else {
        tip.textContent = found.what;
        ring(plot, found.at);
      }
      tip.hidden = false;
      const room = document.documentElement.clientWidth - tip.offsetWidth - 8;
      tip.style.left = `${Math.max(8, Math.min(event.clientX + 14, room)) + window.scrollX}px`;
      tip.style.top = `${event.clientY + 14 + window.scrollY}px`;
    });
    plot.addEventListener("pointerleave", clear);
  }
}

/** Returns what a cell is sorted by: its first number, else its text. */
function key(row, column) {
  const text = row.cells[column].textContent.trim();
  const value = Number.parseFloat(text.replaceAll(",", ""));
  return Number.isNaN(value) ? text : value;
}

for (const head of document.querySelectorAll("thead th")) {
  head.tabIndex = 0;
  const sort = () => {
    const table = head.closest("table");
    const falling = head.getAttribute("aria-sort") !== "descending";
    for (const other of table.querySelectorAll("th")) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", falling ? "descending" : "ascending");
    const rows = [...table.tBodies[0].rows];
    rows.sort((a, b) => {
      const [x, y] = [key(a, head.cellIndex), key(b, head.cellIndex)];
      const order = typeof x === "number" && typeof y === "number" ? x - y : `${x}`.localeCompare(y);
      return falling ? -order : order;
    });
    table.tBodies[0].append(...rows);
  };
  head.addEventListener("click", sort);
  head.addEventListener("keydown", (event) => {
    if (event.key === "Enter") sort();
  });
}

// The form of a new study: what it would be, what it would cost, and the same as a command.

import { ask } from "./actions.js";

const form = document.getElementById("study");
const computes = JSON.parse(form.dataset.computes);
const rows = [...form.querySelectorAll("[data-factor]")];
const grows = document.getElementById("grows");
const field = (name) => form.elements.namedItem(name);
const number = (input) => (input.value.trim() === "" ? null : Number(input.value));

/** Returns what the form asks for, as the coordinator wants it. */
function study() {
  const factors = [];
  const fixed = {};
  for (const row of rows) {
    const name = row.dataset.factor;
    const [low, high, value] = ["low", "high", "value"].map((part) => row.querySelector(`.${part}`));
    if (row.querySelector(".sampled").checked) {
      const own = low && (low.value !== low.dataset.default || high.value !== high.dataset.default);
      factors.push(own ? { name, range: [number(low), number(high)] } : { name });
    } else if (value.value !== value.dataset.default) {
      fixed[name] = value.type === "number" ? number(value) : value.value;
    }
  }
  const tags = field("tags").value.split(",").map((tag) => tag.trim()).filter(Boolean);
  const found = {
    name: field("name").value,
    model: computes.model,
    method: form.dataset.methodName,
    sampling: field("sampling").value,
    rows: number(field("rows")),
    seed: number(field("seed")),
    factors,
  };
  if (Object.keys(fixed).length) found.fixed = fixed;
  if (number(field("priority"))) found.priority = number(field("priority"));
  if (tags.length) found.tags = tags;
  if (grows.checked) {
    found.precision = { output: field("output").value, up_to: number(field("up_to")) };
    if (number(field("target")) !== null) found.precision.target = number(field("target"));
  }
  return found;
}

function duration(seconds) {
  for (const [unit, size] of [["days", 86400], ["hours", 3600], ["minutes", 60]]) {
    if (seconds >= 2 * size) return `${(seconds / size).toPrecision(2)} ${unit}`;
  }
  return `${Math.max(1, Math.round(seconds))} s`;
}

/** Says how many runs it would be, and about how long they would take. */
function cost(wanted) {
  const width = computes.widths[wanted.factors.length];
  if (!width || !wanted.rows) return "This method needs more factors than are sampled.";
  const runs = wanted.rows * width;
  const said = `${runs.toLocaleString()} runs: ${wanted.rows.toLocaleString()} rows of ${width}.`;
  if (computes.seconds === null) return `${said} Nobody has timed this model yet.`;
  if (!computes.workers) return `${said} No worker is there to compute them.`;
  const seconds = (runs * computes.seconds) / computes.workers;
  const whom = computes.workers === 1 ? "the one worker that is there does" : `all ${computes.workers} workers that are there do`;
  return `${said} About ${duration(seconds)} if ${whom} nothing else, each as fast as at the last study of it.`;
}

/** Returns JSON as Python writes it. */
function python(value) {
  if (value === null) return "None";
  if (Array.isArray(value)) return `[${value.map(python).join(", ")}]`;
  if (typeof value !== "object") return JSON.stringify(value);
  return `{${Object.entries(value).map(([k, v]) => `${JSON.stringify(k)}: ${python(v)}`).join(", ")}}`;
}

function tell() {
  const wanted = study();
  document.getElementById("cost").textContent = cost(wanted);
  const body = JSON.stringify(wanted).replaceAll("'", `'\\''`);
  document.getElementById("curl").textContent =
    `curl -X POST ${location.origin}/v1/studies \\\n  -H "Authorization: Bearer $REHYB_TOKEN" \\\n` +
    `  -H 'Content-Type: application/json' \\\n  -d '${body}'`;
  const lines = Object.entries(wanted).map(([k, v]) => `        ${JSON.stringify(k)}: ${python(v)},`);
  document.getElementById("python").textContent =
    `from rehyb.client import Client\n\nwith Client("${location.origin}") as client:\n` +
    `    study = client.submit({\n${lines.join("\n")}\n    })`;
}

/** Returns a key by which a request that is sent twice makes one study. */
const key = () => [...crypto.getRandomValues(new Uint8Array(16))].map((b) => b.toString(16).padStart(2, "0")).join("");
let sent = { body: "", key: "" };

form.addEventListener("input", tell);
grows.addEventListener("change", () => {
  for (const name of ["output", "target", "up_to"]) field(name).disabled = !grows.checked;
  tell();
});
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  const [button, refused] = [document.getElementById("submit"), document.getElementById("refused")];
  const wanted = study();
  const body = JSON.stringify(wanted);
  if (sent.body !== body) sent = { body, key: key() };
  button.disabled = true;
  refused.textContent = "";
  try {
    const made = await ask("POST", "/v1/studies", wanted, { "Idempotency-Key": sent.key });
    location.assign(`/studies/${made.id}`);
  } catch (error) {
    const where = error.pointer ? ` (at ${error.pointer})` : "";
    refused.textContent = [`${error.message}${where}`, ...(error.errors ?? []).map((one) => `${one.pointer}: ${one.detail}`)].join("; ");
    button.disabled = false;
  }
});
tell();

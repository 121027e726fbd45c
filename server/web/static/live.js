// Keeps a page up to date: the coordinator sends the parts that have changed. Only a tab that is
// seen listens, because a browser keeps few connections to one place; one that comes back is sent
// everything as it is now, so nothing is missed.

import { morph } from "./morph.js";
import { now, showTimes } from "./times.js";

const FIGURE = "figure:";
// Long enough for a stream that ends as it should and is taken up again.
const PATIENCE = 2500; // milliseconds
// Two and a half beats (BEAT_SECONDS): a coordinator that hangs keeps its connections.
const SILENCE = 12500;

const banner = document.getElementById("banner");
const link = document.getElementById("link");
const address = document.getElementById("live")?.dataset.stream;
const listeners = [];
let source = null;
let lost = 0;
let silent = 0;
let heard = now();

/** Calls `draw(name, figure)` with every figure that is new or has changed. */
export function onFigure(draw) {
  listeners.push(draw);
}

/** Begins to listen, unless the page has nothing that changes. */
export function follow() {
  if (!address) {
    link.textContent = "";
    return;
  }
  document.addEventListener("visibilitychange", () => (document.hidden ? stop() : start()));
  if (!document.hidden) start();
}

function start() {
  stop();
  source = new EventSource(address);
  source.addEventListener("open", back);
  source.addEventListener("beat", back);
  source.addEventListener("parts", (event) => {
    back();
    show(JSON.parse(event.data));
  });
  source.addEventListener("gone", () => {
    stop();
    say("This is not there any more.");
  });
  source.addEventListener("error", away);
  listen();
}

/** Misses the coordinator when nothing is heard, and asks anew: a connection may be dead. */
function listen() {
  clearTimeout(silent);
  silent = setTimeout(() => {
    missed();
    start();
  }, SILENCE);
}

function stop() {
  source?.close();
  source = null;
  clearTimeout(lost);
  clearTimeout(silent);
  lost = 0;
}

function back() {
  clearTimeout(lost);
  lost = 0;
  heard = now();
  listen();
  banner.hidden = true;
  link.textContent = "live";
  link.className = "link on";
}

function away() {
  // A browser gives up for good when it is refused; then we try by ourselves.
  const refused = source?.readyState === EventSource.CLOSED;
  lost ||= setTimeout(() => {
    lost = 0;
    missed();
    if (refused) again();
  }, PATIENCE);
}

function missed() {
  banner.querySelector("span").textContent = heard;
  banner.hidden = false;
  link.textContent = "not connected";
  link.className = "link off";
}

async function again() {
  try {
    const answer = await fetch(location.href, { cache: "no-store" });
    if (answer.status === 401) {
      location.reload();
      return;
    }
  } catch {
    // Still away.
  }
  if (!document.hidden) start();
}

function say(sentence) {
  banner.textContent = sentence;
  banner.hidden = false;
  link.textContent = "";
}

function show(parts) {
  for (const [name, content] of Object.entries(parts)) {
    if (name.startsWith(FIGURE)) {
      for (const draw of listeners) draw(name.slice(FIGURE.length), content);
      continue;
    }
    const part = document.querySelector(`[data-part="${name}"]`);
    if (!part) continue;
    const fresh = document.createElement("template");
    fresh.innerHTML = content;
    showTimes(fresh.content);
    morph(part, fresh.content);
  }
}

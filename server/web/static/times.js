// Shows times in the reader's own zone, the exact one on hover.

const day = new Intl.DateTimeFormat(undefined, { dateStyle: "medium" });
const clock = new Intl.DateTimeFormat(undefined, { timeStyle: "short" });
const exact = new Intl.DateTimeFormat(undefined, { dateStyle: "full", timeStyle: "long" });

/** Rewrites every <time> below a node. */
export function showTimes(root) {
  for (const element of root.querySelectorAll("time[datetime]")) {
    const at = new Date(element.dateTime);
    const today = new Date().toDateString() === at.toDateString();
    element.textContent = today ? clock.format(at) : `${day.format(at)}, ${clock.format(at)}`;
    element.title = exact.format(at);
  }
}

/** Returns the time of day now. */
export const now = () => clock.format(new Date());

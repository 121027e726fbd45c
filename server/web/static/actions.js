// What a reader orders: buttons and small forms that ask the coordinator for something, with a
// question before what cannot be undone. The page itself changes when the coordinator has done it.

const told = document.getElementById("told");
const dialog = document.getElementById("question");

const PATIENCE = 10000; // milliseconds

/** Asks for something and returns the answer as JSON; throws an Error with the reason if refused. */
export async function ask(method, path, body, headers = {}) {
  let answer;
  try {
    answer = await fetch(path, {
      method,
      headers: { ...(body === undefined ? {} : { "Content-Type": "application/json" }), ...headers },
      body: body === undefined ? undefined : JSON.stringify(body),
      signal: AbortSignal.timeout(PATIENCE),
    });
  } catch (error) {
    if (error.name === "TimeoutError") {
      throw new Error("The coordinator has not answered for 10 s: it may do this yet, or not.");
    }
    throw new Error("The coordinator does not answer; nothing was changed.");
  }
  const text = await answer.text();
  const content = text ? JSON.parse(text) : {};
  if (!answer.ok) throw Object.assign(new Error(content.detail ?? answer.statusText), content);
  return content;
}

/** Says a sentence at the lower edge of the page for a while. */
export function say(sentence, failed = false) {
  told.textContent = sentence;
  told.classList.toggle("failed", failed);
  told.classList.add("shown");
  clearTimeout(say.timer);
  say.timer = setTimeout(() => told.classList.remove("shown"), failed ? 12000 : 4000);
}

/** Asks the reader a question; resolves to whether the answer is yes. */
export function question(text) {
  document.getElementById("asked").textContent = text;
  dialog.returnValue = "no";
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => resolve(dialog.returnValue === "yes"), { once: true });
  });
}

async function order(element, method, path, body) {
  if (element.dataset.question && !(await question(element.dataset.question))) return;
  element.disabled = true;
  try {
    await ask(method, path, body);
    say("Done.");
    if (element.dataset.then) location.assign(element.dataset.then);
  } catch (error) {
    say(error.message, true);
    if (element instanceof HTMLFormElement) element.reset();
  } finally {
    element.disabled = false;
  }
}

/** Returns what a form says, as JSON. */
function content(form) {
  const body = {};
  for (const field of form.elements) {
    if (field.name) body[field.name] = "number" in field.dataset ? Number(field.value) : field.value;
  }
  return body;
}

/** Takes care of all buttons and forms of the page, also those that are yet to come. */
export function act() {
  document.addEventListener("click", (event) => {
    const button = event.target.closest("button[data-path]");
    if (!button) return;
    const { method, path, body } = button.dataset;
    order(button, method, path, body === undefined ? undefined : JSON.parse(body));
  });
  const send = (event) => {
    const form = event.target.closest("form[data-path]");
    if (!form) return;
    event.preventDefault();
    if (form.reportValidity()) order(form, "POST", form.dataset.path, content(form));
  };
  document.addEventListener("submit", send);
  document.addEventListener("change", send);
  // What was refused is not shown as if it were so.
  document.addEventListener("focusout", ({ target }) => {
    if (target.closest("form[data-path]") && !target.validity.valid) target.value = target.defaultValue;
  });
  document.getElementById("sign-out").addEventListener("click", async () => {
    await fetch("/sign-out", { method: "POST" });
    location.assign("/sign-in");
  });
}

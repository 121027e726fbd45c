// Sends a zip file that is dropped or chosen, says how far it is, and asks for what shall be found.

import { ask, say } from "./actions.js";

const form = document.getElementById("upload");
const file = document.getElementById("file");
const sent = document.getElementById("sent");
const answer = document.getElementById("answer");

/** Sends a file; fetch() could not say how much of it has arrived. */
function send(path, blob) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("POST", path);
    request.setRequestHeader("Content-Type", "application/zip");
    request.upload.onprogress = ({ loaded, total }) => {
      sent.value = (100 * loaded) / total;
      answer.textContent = loaded < total ? `${Math.round(sent.value)} % sent` : "being looked at…";
    };
    request.onerror = () => reject(new Error("The coordinator does not answer."));
    request.onload = () => {
      const content = JSON.parse(request.responseText || "{}");
      if (request.status < 300) resolve(content);
      else reject(Object.assign(new Error(content.detail ?? request.statusText), content));
    };
    request.send(blob);
  });
}

async function upload(blob) {
  sent.hidden = false;
  file.disabled = true;
  try {
    const name = blob.name.replace(/\.zip$/i, "").slice(0, 60);
    const session = await send(`${form.dataset.to}${form.dataset.to.endsWith("sessions") ? `?name=${encodeURIComponent(name)}` : ""}`, blob);
    if (form.dataset.to.endsWith("sessions")) {
      await ask("POST", `/v1/sessions/${session.id}/close-loop`);
      answer.textContent = "It is here, and waits for a worker that closes the loop.";
    } else {
      answer.textContent = `The model ${session.name} is here.`;
    }
  } catch (error) {
    const where = ["file", "column", "line"].filter((key) => error[key]).map((key) => `${key} ${error[key]}`);
    answer.textContent = [error.message, ...where].join(", ");
    say("It was refused.", true);
  } finally {
    sent.hidden = true;
    file.disabled = false;
    file.value = "";
  }
}

file.addEventListener("change", () => file.files.length && upload(file.files[0]));
for (const [name, over] of [["dragover", true], ["dragleave", false], ["drop", false]]) {
  form.addEventListener(name, (event) => {
    event.preventDefault();
    form.classList.toggle("over", over);
    if (name === "drop" && event.dataTransfer.files.length) upload(event.dataTransfer.files[0]);
  });
}

// A form of choices changes the address as soon as one is made.

/** Takes care of every such form. */
export function choose() {
  for (const form of document.querySelectorAll("form.choices")) {
    form.addEventListener("change", () => form.requestSubmit());
    form.addEventListener("submit", () => {
      // What is not chosen need not be in the address.
      for (const field of form.elements) field.disabled = field.value === "" || !field.name;
      setTimeout(() => {
        for (const field of form.elements) field.disabled = false;
      });
    });
  }
}

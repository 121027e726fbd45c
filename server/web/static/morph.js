// Makes one piece of the page like another with as few changes as it takes: what a reader has
// focused, opened, scrolled or begun to type stays as it is.

/** Returns what tells an element from its neighbours. */
const key = (node) => node.dataset?.key ?? node.id ?? "";

const alike = (a, b) => a.nodeType === b.nodeType && a.nodeName === b.nodeName && key(a) === key(b);

function attributes(old, fresh) {
  for (const { name } of [...old.attributes]) {
    // Whether a reader has opened something is the reader's.
    if (!fresh.hasAttribute(name) && name !== "open") old.removeAttribute(name);
  }
  for (const { name, value } of fresh.attributes) {
    if (name === "open" || old.getAttribute(name) === value) continue;
    old.setAttribute(name, value);
    if (name === "value" && old !== document.activeElement) old.value = value;
  }
}

/** Makes the children of `old` those of `fresh`. */
export function morph(old, fresh) {
  let at = old.firstChild;
  for (const child of [...fresh.childNodes]) {
    let match = at;
    while (match && !alike(match, child)) match = match.nextSibling;
    if (!match) {
      old.insertBefore(child, at);
      continue;
    }
    if (match !== at) {
      // Elements with a name of their own move; others in between have gone.
      if (key(match)) old.insertBefore(match, at);
      else while (at !== match) at = remove(at);
    }
    if (match.nodeType !== Node.ELEMENT_NODE) {
      if (match.nodeValue !== child.nodeValue) match.nodeValue = child.nodeValue;
    } else if (!match.hasAttribute("data-own")) {
      attributes(match, child);
      morph(match, child);
    }
    at = match.nextSibling;
  }
  while (at) at = remove(at);
}

function remove(node) {
  const next = node.nextSibling;
  node.remove();
  return next;
}

/** The few things that all parts do with the document. Text only ever enters as text. */

/** The element with an id. */
export const byId = (id) => document.getElementById(id);

/** Set a text where it differs: nothing is laid out anew for what stays. */
export function put(node, text) {
  if (node.said !== text) {
    node.said = text;
    node.textContent = text;
  }
}

/** Set a mark of which styles depend, where it differs. */
export function mark(node, name, value) {
  if (node.dataset[name] !== value) node.dataset[name] = value;
}

/** Make an element: attributes, then children, which are elements or text. */
export function make(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === true) node.setAttribute(name, "");
    else if (value !== false && value != null) node.setAttribute(name, value);
  }
  node.append(...children);
  return node;
}

/** Make an element of a drawing. */
export function svg(tag, attributes) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  return node;
}

/** A button that cannot be used stays in the order of Tab and says so. */
export function allow(button, may, why = "") {
  button.setAttribute("aria-disabled", String(!may));
  button.title = may ? "" : why;
}

/** Whether a button may be used. */
export const allowed = (button) => button.getAttribute("aria-disabled") !== "true";

/** Open a dialog. Not as a modal one: that would keep a hand from STOP. */
export function open(dialog) {
  if (dialog.open) return;
  dialog.opener = document.activeElement;
  dialog.show();
  dialog.querySelector("[autofocus]")?.focus();
}

/** Close it, and give the focus back. */
export function close(dialog) {
  if (!dialog.open) return;
  dialog.close();
  dialog.opener?.focus();
}

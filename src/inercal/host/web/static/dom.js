/** Helpers for the document that all parts use. Text is only inserted as text, never as HTML. */

/** Return the element with an id. */
export const byId = (id) => document.getElementById(id);

/** Set a text if it differs, so that an unchanged text causes no new layout. */
export function put(node, text) {
  if (node.said !== text) {
    node.said = text;
    node.textContent = text;
  }
}

/** Set an attribute on which styles depend, if it differs. */
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

/** Make an SVG element. */
export function svg(tag, attributes) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  return node;
}

/** Disable a button but keep it in the Tab order, so that it can say why. */
export function allow(button, may, why = "") {
  button.setAttribute("aria-disabled", String(!may));
  button.title = may ? "" : why;
}

/** Whether a button can be used. */
export const allowed = (button) => button.getAttribute("aria-disabled") !== "true";

/** Open a dialog that is not modal, because a modal one would block STOP. */
export function open(dialog) {
  if (dialog.open) return;
  dialog.opener = document.activeElement;
  dialog.show();
  dialog.querySelector("[autofocus]")?.focus();
}

/** Close a dialog, and return the focus. */
export function close(dialog) {
  if (!dialog.open) return;
  dialog.close();
  dialog.opener?.focus();
}

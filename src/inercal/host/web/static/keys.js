/**
 * Keyboard shortcuts. STOP needs the same key twice within a second: a frightened hand does this by
 * itself, but a slip from another key does not. Holding the key also counts.
 */

import { byId, close, open } from "./dom.js";
import { notice } from "./notice.js";
import { ofDevice } from "./store.js";

const TWICE = 1000; // ms
const OFF = "inercal.basics.keys-off";

/** Listen for keys, which do the same as the buttons. */
export function listen(controls) {
  const on = byId("keys-on");
  const help = byId("show-help");
  let first = -Infinity;
  let sent = -Infinity;

  on.checked = !ofDevice.get(OFF);
  on.addEventListener("change", () => ofDevice.set(OFF, on.checked ? null : "yes"));
  byId("help").addEventListener("click", () => (help.open ? close(help) : open(help)));

  addEventListener("keydown", (event) => {
    if (event.key === "Escape") {
      for (const dialog of document.querySelectorAll("dialog[open]")) close(dialog);
      return;
    }
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (!on.checked || typing(event.target)) return;
    const key = event.key.toLowerCase();
    if (key === "s") {
      const now = event.timeStamp;
      if (now - sent < TWICE) return; // a key that is held keeps repeating
      if (now - first < TWICE) {
        [first, sent] = [-Infinity, now];
        controls.stop();
      } else {
        first = now;
        notice("s once more: STOP");
      }
      return;
    }
    if (event.repeat) return;
    if (key === "p") controls.pause();
    else if (key === "g") controls.goOn();
    else if (key === "a") controls.abort();
    else if (key === "?") open(help);
  });
}

/** Letters typed in a field are not commands; in a list they select an entry. */
function typing(target) {
  if (target instanceof HTMLInputElement) return !["checkbox", "radio"].includes(target.type);
  return target instanceof HTMLTextAreaElement || target instanceof HTMLSelectElement;
}

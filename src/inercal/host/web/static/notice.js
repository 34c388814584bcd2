/** The outcome of this viewer's actions. */

import { byId } from "./dom.js";
import { say, seen } from "./live.js";

const LASTS = 12_000; // ms
let timer = 0;

/** Show a text for a while. */
export function notice(words) {
  byId("notice").textContent = words;
  clearTimeout(timer);
  timer = setTimeout(() => (byId("notice").textContent = ""), LASTS);
}

/** Send a command, and show that it was sent or why not. */
export function order(command, words) {
  notice(say(command) ? words : unsent());
}

/** Why nothing was sent. */
export function unsent() {
  return ["quiet", "silent"].includes(seen.link) ? "This page shows old data, so nothing was sent."
    : "Not connected, so nothing was sent.";
}

/** What came of something that this viewer did. */

import { byId } from "./dom.js";
import { say, seen } from "./live.js";

const LASTS = 12_000; // ms
let timer = 0;

/** Say something for a while. */
export function notice(words) {
  byId("notice").textContent = words;
  clearTimeout(timer);
  timer = setTimeout(() => (byId("notice").textContent = ""), LASTS);
}

/** Send a command; say so, or why not. */
export function order(command, words) {
  notice(say(command) ? words : unsent());
}

/** Why nothing was sent. */
export function unsent() {
  return ["quiet", "silent"].includes(seen.link) ? "This page shows old data, so nothing was sent."
    : "Not connected, so nothing was sent.";
}

/** What came of something that this viewer did. */

import { byId } from "./dom.js";
import { say } from "./live.js";

const LASTS = 12_000; // ms
let timer = 0;

/** Say something for a while. */
export function notice(words) {
  byId("notice").textContent = words;
  clearTimeout(timer);
  timer = setTimeout(() => (byId("notice").textContent = ""), LASTS);
}

/** Send a command, and say so. */
export function order(command, words) {
  notice(say(command) ? words : "Not connected: nothing was sent.");
}

/** What was said: newest first. Levels have a word and a sign besides their colour. */

import { byId, make, put } from "./dom.js";
import { clock } from "./format.js";
import { seen } from "./live.js";

const SIGNS = { info: "·", warning: "▲ warning", alarm: "■ ALARM" };
const MOST = 500;

export function makeEvents() {
  const [list, said] = ["event-list", "said"].map(byId);

  function event({ level, time, words, at }) {
    const line = make("li", { class: level, title: at ?? "" },
      make("span", { class: "time" }, clock(time)),
      make("span", { class: "level" }, SIGNS[level] ?? level), " ",
      make("span", { class: "words" }, words));
    list.prepend(line);
    while (list.childElementCount > MOST) list.lastElementChild.remove();
    // What came before this page did is not read aloud, and alarms are by their own region.
    if (seen.state && level !== "alarm") put(said, level === "info" ? words : `${level}: ${words}`);
  }

  return { plan: () => list.replaceChildren(), event };
}

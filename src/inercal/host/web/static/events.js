/** The events, newest first. Levels have a word and a sign in addition to their colour. */

import { byId, make, put } from "./dom.js";
import { clock } from "./format.js";
import { seen } from "./live.js";

const SIGNS = { info: "·", warning: "▲ warning", note: "✎ note", alarm: "■ ALARM" };
const MOST = 500;

/** `show(time)` shows the readings at a time in the plots. */
export function makeEvents(marks, show) {
  const [list, said] = ["event-list", "said"].map(byId);
  let lines = new Map(); // the line of each event

  function line(event) {
    const { level, time, words, at } = event;
    const when = Number.isFinite(time)
      ? make("button", { type: "button", class: "time", "aria-label": `${clock(time)}: show it in the plots` }, clock(time))
      : make("span", { class: "time" }, clock(time));
    when.addEventListener("click", () => Number.isFinite(time) && show(time));
    const made = make("li", { class: level, title: at ?? "" }, when,
      make("span", {}, make("span", { class: "level" }, SIGNS[level] ?? level), " ", words));
    lines.set(event, made);
    return made;
  }

  function add(some) {
    for (const [event, next] of marks.add(some)) {
      const after = next && lines.get(next);
      if (after) after.after(line(event));
      else list.prepend(line(event));
    }
    while (list.childElementCount > MOST) list.lastElementChild.remove();
  }

  function event(message) {
    add([message]);
    const { level, words } = message;
    // Events from before the page was opened are not read aloud; alarms have their own region.
    if (seen.state && level !== "alarm") put(said, level === "info" ? words : `${level}: ${words}`);
  }

  function plan() {
    marks.clear();
    lines = new Map();
    list.replaceChildren();
  }

  return { plan, event, events: ({ events }) => add(events) };
}

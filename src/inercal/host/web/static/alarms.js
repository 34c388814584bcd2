/** Alarms stay on top until the viewer acknowledges them, even if the page is reloaded. */

import { byId, make, put } from "./dom.js";
import { clock } from "./format.js";
import { seen } from "./live.js";
import { ofTab } from "./store.js";

const KNOWN = "inercal.alarms"; // acknowledged alarms of this tab, with their run
const MOST = 500;

export function makeAlarms() {
  const region = byId("alarms");
  let ringing = new Map(); // by text: the line, how often the alarm occurred, and its keys

  function event({ level, time, words, at }) {
    if (level !== "alarm") return;
    const key = `${seen.plan?.run}|${at}|${words}`;
    if (known().includes(key)) return;
    const one = ringing.get(words) ?? begin(words);
    one.keys.push(key);
    const often = one.keys.length > 1 ? ` (${one.keys.length} times)` : "";
    put(one.said, `${clock(time)}: ${words}${often}`);
  }

  function begin(words) {
    const label = `Acknowledge: ${words}`;
    const button = make("button", { type: "button", "aria-label": label }, "Acknowledge");
    const said = make("span");
    const line = make("div", { class: "ringing" },
      make("p", {}, make("strong", {}, "■ ALARM "), said), button);
    const one = { said, keys: [] };
    button.addEventListener("click", () => {
      ofTab.set(KNOWN, JSON.stringify([...known(), ...one.keys].slice(-MOST)));
      ringing.delete(words);
      const next = line.nextElementSibling ?? line.previousElementSibling;
      line.remove();
      (next?.querySelector("button") ?? byId("stop")).focus();
    });
    ringing.set(words, one);
    region.prepend(line);
    return one;
  }

  function clear() {
    ringing = new Map();
    region.replaceChildren();
  }

  return { plan: clear, idle: clear, event };
}

function known() {
  try {
    return JSON.parse(ofTab.get(KNOWN)) ?? [];
  } catch {
    return [];
  }
}

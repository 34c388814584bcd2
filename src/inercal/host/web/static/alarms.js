/** Alarms stay on top until the viewer has acknowledged them, also when the page is loaded anew. */

import { byId, make } from "./dom.js";
import { clock } from "./format.js";
import { seen } from "./live.js";

const KNOWN = "inercal.alarms"; // of this tab: those that were acknowledged, with their run

export function makeAlarms() {
  const region = byId("alarms");

  function event({ level, time, words, at }) {
    if (level !== "alarm") return;
    const key = `${seen.plan?.run}|${at}|${words}`;
    if (known().includes(key)) return;
    const label = `Acknowledge: ${words}`;
    const button = make("button", { type: "button", "aria-label": label }, "Acknowledge");
    const line = make("div", { class: "ringing" },
      make("p", {}, make("strong", {}, "■ ALARM "), `${clock(time)}: ${words}`), button);
    button.addEventListener("click", () => {
      sessionStorage.setItem(KNOWN, JSON.stringify([...known().slice(-99), key]));
      const next = line.nextElementSibling ?? line.previousElementSibling;
      line.remove();
      (next?.querySelector("button") ?? byId("stop")).focus();
    });
    region.prepend(line);
  }

  return { plan: () => region.replaceChildren(), idle: () => region.replaceChildren(), event };
}

function known() {
  try {
    return JSON.parse(sessionStorage.getItem(KNOWN)) ?? [];
  } catch {
    return [];
  }
}

/** After the run: its result, and what to do next. */

import { byId, make, mark, put } from "./dom.js";
import { SIGNS } from "./estimates.js";
import { seen } from "./live.js";
import { order } from "./notice.js";

const AGAIN = new Set(["carried out", "interrupted"]); // states in which a run can be resumed
const LINKS = [
  ["report", "Report"],
  ["calibration", "Calibration file"],
  ["history", "Sensor history"],
];
const TITLES = {
  done: "The run is complete",
  "carried out": "The measurement is complete, but there is no calibration",
  interrupted: "The run was interrupted",
  "not begun": "The run did not start",
  manual: "Manual control has ended",
};

export function makeFinished(people) {
  const [section, results, resume, away] = ["finished", "results", "resume", "put-away"].map(byId);
  let told = ""; // the end that was shown; a page that reconnects does not jump to it again

  away.addEventListener("click", () => {
    people.whenOperating(() => order({ do: "put away" }, ""));
  });
  resume.addEventListener("click", () => {
    const command = { do: "resume", run: seen.done?.run, table: null, imu: null };
    people.whenOperating(() => order(command, "Resuming …"));
  });

  function done(message) {
    const { verdict, state } = message;
    const tone = verdict?.level ?? ({ done: "good", manual: "care" }[state] ?? "bad");
    section.className = `verdict ${tone}`;
    mark(section, "state", state);
    put(byId("verdict"), TITLES[state] ?? state);
    const byHand = state === "manual"; // nothing was tested, so only the reason for the end is shown
    put(byId("verdict-words"), verdict ? `${SIGNS[tone] ?? ""} ${verdict.words}` : byHand ? message.words : "");
    put(byId("verdict-reasons"), verdict?.reasons?.join("; ") ?? "");
    put(byId("done-words"), message.words ?? "");
    // The numbers behind a verdict are one click away; the reason for a missing verdict is visible.
    byId("verdict-details").open = !verdict;
    byId("verdict-details").hidden = !message.words || byHand;
    const link = { target: "_blank", rel: "noopener", class: "button" };
    results.replaceChildren(...LINKS.filter(([key]) => own(message[key])).map(([key, words]) =>
      make("a", { href: message[key], download: key === "calibration", ...link }, words)));
    resume.hidden = !AGAIN.has(state);
    section.hidden = false;
    const end = JSON.stringify(message);
    if (end === told) return;
    told = end;
    put(byId("said"), [TITLES[state] ?? state, verdict?.words, message.words].filter(Boolean)
      .join(". "));
    section.scrollIntoView({ block: "nearest" });
  }

  function hide() {
    section.hidden = true;
  }

  /** The same end message may come from another attempt. */
  function begins() {
    told = "";
    hide();
  }

  return { plan: hide, phase: begins, idle: begins, done };
}

/** Return a link only if it leads to this server. */
function own(href) {
  return typeof href === "string" && new URL(href, location.href).origin === location.origin;
}

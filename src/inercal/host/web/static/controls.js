/** The buttons of a run. */

import { allow, allowed, byId, close, open } from "./dom.js";
import { going, heardSince, say, seen } from "./live.js";
import { notice, order, unsent } from "./notice.js";

const UNANSWERED = "STOP was sent, but the bench sends no data: use the emergency stop.";

export function makeControls() {
  const [stop, pause, goOn, abort] = ["stop", "pause", "go-on", "abort"].map(byId);
  const asking = byId("ask-abort");
  const note = byId("note-form");
  let stopped = NaN; // ms: time of the last STOP

  stop.addEventListener("click", stopNow);
  pause.addEventListener("click", () => ask(pause, "pause", "Pause requested."));
  goOn.addEventListener("click", () => ask(goOn, "go on", "Continue requested."));
  abort.addEventListener("click", () => {
    if (allowed(abort)) open(asking);
    else notice(abort.title);
  });
  byId("abort-yes").addEventListener("click", () => {
    close(asking);
    ask(abort, "abort", "Abort requested.");
  });
  for (const button of document.querySelectorAll("[data-closes]")) {
    button.addEventListener("click", () => close(button.closest("dialog")));
  }
  note.addEventListener("submit", (event) => {
    event.preventDefault();
    const text = byId("note").value.trim();
    if (!text) return byId("note").focus();
    if (!say({ do: "note", text })) return notice(unsent());
    byId("note").value = "";
  });
  show();

  /** Any viewer may stop; the request goes to the watchdog. */
  function stopNow() {
    if (!say({ do: "stop" })) {
      notice("STOP was NOT sent because there is no connection: use the emergency stop.");
      return stopWithoutSocket();
    }
    stopped = performance.now();
    if (seen.link === "quiet") return unsure();
    if (seen.link === "silent") {
      return notice(UNANSWERED);
    }
    notice(going() ? "STOP was sent." : "STOP was sent, although no run seems to be active.");
  }

  /** The server may be reachable even if it has no place for the socket of this page. */
  async function stopWithoutSocket() {
    const answer = await fetch("/api/stop", { method: "POST" }).catch(() => null);
    if (!answer?.ok) return;
    notice(UNANSWERED);
  }

  function unsure() {
    notice("STOP was sent, but the server does not answer, so it may NOT have arrived. Use the "
      + "emergency stop.");
  }

  /** The connection may already have been broken when STOP was sent over it. */
  function link({ link: now }) {
    if (["quiet", "lost"].includes(now) && !Number.isNaN(stopped) && !heardSince(stopped)) {
      unsure();
      stopped = NaN;
    }
    show();
  }

  function ask(button, what, words) {
    if (allowed(button)) order({ do: what }, words);
    else notice(button.title);
  }

  /** Update which buttons can be used, and why the others cannot. */
  function show() {
    const paused = Boolean(seen.state?.paused) || seen.state?.phase === "paused";
    const phase = seen.state?.phase; // stays set while the results of the run are being made
    const why = !going() ? "no run is active"
      : seen.plan?.manual ? "the table is under manual control: use its panel"
      : phase === "done" ? "the table is at rest and the results are being computed"
      : phase === "aborted" ? "the run is already ending"
      : seen.link === "lost" ? "not connected"
      : !seen.people.yours ? "only the operator can do this: take control first" : "";
    const begun = seen.state !== null && !seen.phase;
    const old = seen.link === "live" ? "" : "this page shows old data";
    const idle = paused ? "the run is paused" : "nothing is moving the table now";
    allow(pause, !why && begun && !paused, why || idle);
    allow(goOn, !why && paused && !old, why || (paused ? old : "the run is not paused"));
    allow(abort, !why, why);
    note.hidden = !going() || !seen.people.yours || !seen.plan;
    document.body.classList.toggle("paused", paused && going());
  }

  return {
    stop: stopNow,
    pause: () => pause.click(),
    goOn: () => goOn.click(),
    abort: () => abort.click(),
    people: show, plan: show, idle: show, phase: show, state: show, done: show, link,
    refused: ({ words }) => notice(`Refused: ${words}`),
  };
}

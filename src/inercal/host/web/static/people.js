/** Who operates: one, by name; all others watch. */

import { byId, close, open, put } from "./dom.js";
import { say, seen } from "./live.js";
import { notice, unsent } from "./notice.js";
import { ofDevice, ofTab } from "./store.js";

const NAME = "inercal.name";
const OPERATES = "inercal.operates"; // of this tab: by what name, and when that was known last
const GRACE = 10_000; // ms: as long as the server keeps the place of one who is gone
const AGAIN = 3000; // ms
const ATTEMPTS = 5;

export function makePeople() {
  const [control, shown, name, again] = ["control", "people", "name", "name-again"].map(byId);
  const asking = byId("ask-name");
  let then = null; // what was wanted of one who did not operate yet
  let answered = false;
  let left = 0;
  let timer = 0;

  name.value = ofDevice.get(NAME) ?? "";
  name.addEventListener("input", () => ofDevice.set(NAME, name.value));
  control.addEventListener("click", () => (seen.people.yours ? give() : whenOperating(null)));
  name.addEventListener("keydown", (event) => {
    if (event.key === "Enter") whenOperating(null);
  });
  byId("name-form").addEventListener("submit", (event) => {
    event.preventDefault();
    if (!again.value.trim()) return again.focus();
    name.value = again.value.trim();
    ofDevice.set(NAME, name.value);
    answered = true;
    close(asking);
    ask();
  });
  // What was wanted is not done later on, when control is taken for something else.
  asking.addEventListener("close", () => {
    if (!answered) then = null;
    answered = false;
  });

  function give() {
    ofTab.set(OPERATES, null);
    say({ do: "leave" });
  }

  /** Do something as operator: take control first where nobody else has it. */
  function whenOperating(what) {
    if (seen.people.yours) return what?.();
    if (what && seen.link !== "live") return notice(unsent()); // it would be done when it is, later
    then = what;
    if (name.value.trim()) return ask();
    if (document.body.dataset.view === "setup") {
      then = null; // what is wanted is pressed again: typing a name moves no table
      notice("Say your name first.");
      return name.focus();
    }
    again.value = "";
    open(asking);
  }

  function ask(as = name.value.trim()) {
    if (say({ do: "operate", name: as })) return;
    then = null;
    notice(unsent());
  }

  /**
   * A page that was loaded anew, or whose connection broke, asks for the control that it had: for as
   * long as the server keeps it. Who comes back later may find the table in other hands.
   */
  function reclaim() {
    clearTimeout(timer);
    const had = operated();
    if (seen.people.yours || left <= 0 || !had) return;
    const { operator } = seen.people;
    if (operator !== null && operator !== had.name) return;
    left -= 1;
    ask(had.name);
    timer = setTimeout(reclaim, AGAIN);
  }

  function people(message) {
    const { viewers, operator, yours } = message;
    const who = yours ? `you operate (${operator})` : `${operator ?? "nobody"} operates`;
    put(shown, `${who} · ${viewers} ${viewers === 1 ? "viewer" : "viewers"}`);
    put(control, yours ? "Give control back" : "Take control");
    put(byId("who-says"), yours ? "You operate. Everybody else watches."
      : operator ? `${operator} operates; you watch.` : "One operates, everybody else watches.");
    if (!yours && operator !== null && operator !== operated()?.name) ofTab.set(OPERATES, null);
    if (!yours) return;
    stamp();
    const wanted = then;
    then = null;
    wanted?.();
  }

  /** What is known last of one's own control, where that is not too long ago. */
  function operated() {
    try {
      const had = JSON.parse(ofTab.get(OPERATES));
      return Date.now() - had.at < GRACE ? had : null;
    } catch {
      return null; // there is nothing, or nothing that this page wrote
    }
  }

  function stamp() {
    const { yours, operator } = seen.people;
    if (yours) ofTab.set(OPERATES, JSON.stringify({ name: operator, at: Date.now() }));
  }

  return {
    whenOperating,
    beat: stamp,
    hello: () => {
      left = ATTEMPTS;
      setTimeout(reclaim, 300);
    },
    people,
    refused: () => (then = null),
    link: ({ link }) => {
      if (link !== "live") then = null;
    },
  };
}

/** The operator, shown by name; all others only watch. */

import { byId, close, mark, open, put } from "./dom.js";
import { say, seen } from "./live.js";
import { notice, unsent } from "./notice.js";
import { ofDevice } from "./store.js";

const NAME = "inercal.name";

export function makePeople() {
  const [control, shown, name, again] = ["control", "people", "name", "name-again"].map(byId);
  const asking = byId("ask-name");
  let then = null; // the action that a viewer wanted before becoming operator
  let answered = false;

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
  // The wanted action is not executed later, when control is taken for something else.
  asking.addEventListener("close", () => {
    if (!answered) then = null;
    answered = false;
  });

  function give() {
    say({ do: "leave" });
  }

  /** Do something as operator: take control first if nobody else has it. */
  function whenOperating(what) {
    if (seen.people.yours) return what?.();
    if (what && seen.link !== "live") return notice(unsent()); // otherwise it would be executed later
    then = what;
    if (name.value.trim()) return ask();
    if (document.body.dataset.view === "setup") {
      then = null; // the user must press again, so that typing a name moves no table
      notice("Enter your name first.");
      return name.focus();
    }
    again.value = "";
    open(asking);
  }

  function ask() {
    if (say({ do: "operate", name: name.value.trim() })) return;
    then = null;
    notice(unsent());
  }

  function people(message) {
    const { viewers, operator, yours } = message;
    const who = yours ? `operator: you (${operator})` : operator ? `operator: ${operator}` : "no operator";
    put(shown, `${who} · ${viewers} ${viewers === 1 ? "viewer" : "viewers"}`);
    mark(shown, "operator", yours ? "me" : operator ? "other" : "none");
    put(control, yours ? "Release control" : "Take control");
    put(byId("who-says"), yours ? "You operate; everyone else watches."
      : operator ? `${operator} operates; you watch.` : "One person operates; everyone else watches.");
    if (!yours) return;
    const wanted = then;
    then = null;
    wanted?.();
  }

  return {
    whenOperating,
    people,
    refused: () => (then = null),
    link: ({ link }) => {
      if (link !== "live") then = null;
    },
  };
}

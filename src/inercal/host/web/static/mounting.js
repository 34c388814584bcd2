/** A mounting of the sensor: the request to the operator, and the button that confirms it. */

import { allow, allowed, byId, put } from "./dom.js";
import { seen } from "./live.js";
import { notice, order } from "./notice.js";

export function makeMounting() {
  const [place, words, button] = ["mounting", "mounting-words", "mounted"].map(byId);

  button.addEventListener("click", () => {
    const asked = seen.state?.mounting;
    if (!allowed(button) || !asked) return notice(button.title);
    // The number identifies the request, so that a second click does not confirm another one.
    const { number, mounting } = asked;
    order({ do: "mounted", number, mounting }, "The confirmation was sent.");
  });

  function plan({ spins, live }) {
    document.body.classList.toggle("rates", Boolean(spins));
    document.body.classList.toggle("no-live", live === false);
    document.body.classList.remove("ended");
    show();
  }

  function done() {
    document.body.classList.add("ended");
    show();
  }

  function show() {
    const asked = seen.done ? null : seen.state?.mounting;
    const appears = place.hidden && asked;
    place.hidden = !asked;
    if (!asked) return;
    put(words, `${sentence(asked.instruction)}.`);
    const why = !seen.people.yours ? "only the operator can do this: take control first"
      : seen.link !== "live" ? "this page shows old data"
      : seen.state.paused ? "the run is paused" : "";
    allow(button, !why, why);
    put(byId("mounted-why"), why ? `You cannot confirm it now: ${why}` : "");
    if (appears) place.scrollIntoView({ block: "nearest" });
  }

  return { plan, done, state: show, people: show, link: show, idle: show };
}

const sentence = (text) => text.charAt(0).toUpperCase() + text.slice(1);

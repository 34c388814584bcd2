/** The steps of the plan: done, current and remaining. */

import { byId, make, put } from "./dom.js";
import { clock, lasting } from "./format.js";

const SIGNS = { done: "✓", now: "▶", "to-come": "·" };
const WORDS = { done: "done:", now: "current:", "to-come": "to come:" };

export function makeSteps() {
  const [list, summary] = ["step-list", "steps-done"].map(byId);
  let items = [];
  let shown = NaN;
  let total = 0;

  function plan(message) {
    shown = NaN;
    total = message.steps.length;
    items = message.steps.map((step, i) => {
      const sign = make("span", { class: "sign", role: "img" });
      const node = make("li", {}, sign, make("span", { class: "label" }, `${i + 1}. ${step.label}`),
        make("span", { class: "small" }, `${step.what}, ${lasting(step.seconds)}`));
      return { node, sign };
    });
    list.replaceChildren(...items.map(({ node }) => node));
    list.scrollTop = 0;
    mark(0, false);
  }

  function state(message) {
    mark(message.done, message.phase !== "done");
    put(summary, `${message.done} of ${total} done, ${clock(message.remaining)} left`);
  }

  /** Mark the first `done` steps as done and the next one as current. */
  function mark(done, going) {
    const key = going ? done : -1 - done;
    if (key === shown) return;
    shown = key;
    items.forEach(({ node, sign }, i) => {
      const what = i < done ? "done" : i === done && going ? "now" : "to-come";
      if (node.className === what) return;
      node.className = what;
      put(sign, SIGNS[what]);
      sign.setAttribute("aria-label", WORDS[what]);
      if (what === "now") node.setAttribute("aria-current", "step");
      else node.removeAttribute("aria-current");
    });
    // Scroll only the list, so that the page stays where the operator is looking.
    const node = items[Math.min(done, items.length - 1)]?.node;
    if (node) list.scrollTop = node.offsetTop - list.clientHeight / 3;
  }

  function done() {
    mark(items.filter(({ node }) => node.className === "done").length, false);
  }

  return { plan, state, done };
}

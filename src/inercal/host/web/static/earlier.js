/** Earlier runs: an interrupted run can be resumed, and a finished run has its report. */

import { byId, make } from "./dom.js";
import { moment } from "./format.js";
import { order } from "./notice.js";

const SIGNS = { done: "✓ done", interrupted: "‖ interrupted", running: "▶ running",
  "carried out": "▷ measured, not yet calibrated" };

const LATER = [3000, 10_000]; // ms after STOP; a run without a page does not report its end

export function makeEarlier(people, setup) {
  const list = byId("runs");
  const chosen = byId("chosen-devices");
  setup.loaded.push(({ runs }) => {
    const focused = list.contains(document.activeElement) && labelOf(document.activeElement);
    list.replaceChildren(...runs.map(line));
    if (!runs.length) list.append(make("li", {}, "None yet."));
    // Focus the same run again, but no other one if it is gone: Enter would do something unwanted.
    if (focused === false) return;
    const same = [...list.querySelectorAll("button, a")].find((one) => labelOf(one) === focused);
    (same ?? list).focus({ preventScroll: true });
  });

  function line(run) {
    const named = `${run.sensor}, ${moment(run.begun)}`;
    const words = run.trouble ? `${run.state} · ${run.trouble}`
      : `${moment(run.begun)} · ${SIGNS[run.state] ?? run.state} · ${run.id}`;
    const node = make("li", {},
      make("strong", {}, run.sensor), " ", make("span", { class: "small" }, words));
    const offers = make("span", { class: "buttons" });
    if (run.report) {
      const href = `/runs/${encodeURIComponent(run.id)}/report`;
      offers.append(make("a", { href, target: "_blank", rel: "noopener", class: "button",
        "aria-label": `Report of ${named}` }, "Report"));
    }
    if (run.state === "interrupted" || run.state === "carried out") {
      const button = make("button", { type: "button", "aria-label": `Resume ${named}` }, "Resume");
      button.addEventListener("click", () => resume(run));
      offers.append(button);
    }
    if (run.state === "running") {
      // The run continues without this page, because the server was restarted meanwhile.
      const label = `STOP ${named}`;
      const looks = { type: "button", class: "grave", "aria-label": label };
      const button = make("button", looks, "STOP");
      button.addEventListener("click", () => stop(run));
      offers.append(button);
    }
    if (offers.childNodes.length) node.append(offers);
    return node;
  }

  function stop(run) {
    order({ do: "stop", run: run.id }, "STOP was sent.");
    for (const later of LATER) {
      setTimeout(() => document.body.dataset.view === "setup" && setup.load(), later);
    }
  }

  function resume(run) {
    people.whenOperating(() => {
      const devices = chosen.checked ? setup.devices() : { table: null, imu: null };
      order({ do: "resume", run: run.id, ...devices }, "Resuming …");
    });
  }

  return {};
}

const labelOf = (node) => node.getAttribute("aria-label");

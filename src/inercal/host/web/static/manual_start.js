/** Starts a manual session: a part of the set-up, and a question that names the table. */

import { allow, allowed, byId, make, put } from "./dom.js";
import { order } from "./notice.js";

export function makeManualStart(people, setup) {
  const [start, why, asking, withImu] = ["start-manual", "start-manual-why", "ask-manual", "with-imu"].map(byId);
  let wanted = null; // the session in the question, which is the one that starts

  start.addEventListener("click", () => {
    if (allowed(start)) people.whenOperating(confirm);
    else put(why, start.title);
  });
  byId("manual-yes").addEventListener("click", () => {
    asking.close();
    if (wanted) order({ do: "begin manual", ...wanted }, "Starting …");
    wanted = null;
  });
  for (const name of ["change", "input"]) byId("form").addEventListener(name, show);
  setup.loaded?.push(show);

  function show() {
    const reason = setup.chosen?.(withImu.checked).why ?? "";
    allow(start, !reason, reason);
    put(why, reason ? `Before you can start: ${reason}` : "");
  }

  function confirm() {
    const { planId, plan, table, imu, devices } = setup.chosen(withImu.checked);
    wanted = { plan: planId, with_imu: withImu.checked, ...devices };
    const facts = [["table", table], ["axes and limits from", plan.file], ["IMU", withImu.checked ? imu : "not read"]];
    byId("ask-manual-facts").replaceChildren(...facts.map(([name, value]) =>
      make("div", {}, make("dt", {}, name), make("dd", {}, value))));
    put(byId("ask-manual-table"), table);
    if (!asking.open) asking.show();
    asking.querySelector("[autofocus]")?.focus();
  }

  return { idle: show };
}

/** What table and IMU say of themselves. */

import { byId, make, put } from "./dom.js";
import { fixed } from "./format.js";

const COUNTS = [
  ["packets", "packets"],
  ["lost", "packets that never came"],
  ["failed", "packets with wrong checks, thrown away"],
  ["thrown", "bytes thrown away between packets"],
  ["samples", "samples with an angle"],
  ["no_angle", "samples without an angle: the table was read too seldom"],
];
const GRAVE = new Set(["lost", "failed", "no_angle"]);

export function makeBench() {
  const [axes, facts] = ["axes", "imu-facts"].map(byId);
  let rows = [];
  const shown = {};
  for (const [key, words] of [...COUNTS, ["temperature", "temperature"]]) {
    shown[key] = make("dd", {}, "—");
    facts.append(make("div", {}, make("dt", {}, words), shown[key]));
  }

  function plan(message) {
    const heads = ["axis", "angle, °", "rate, °/s", "following error, ″", "state"];
    rows = message.axes.map(() => heads.slice(1).map(() => make("td", {}, "—")));
    axes.replaceChildren(
      make("thead", {}, make("tr", {}, ...heads.map((text) => make("th", { scope: "col" }, text)))),
      make("tbody", {}, ...message.axes.map((name, i) =>
        make("tr", {}, make("th", { scope: "row" }, name), ...rows[i]))),
    );
    for (const node of Object.values(shown)) put(node, "—");
  }

  function state({ table, imu }) {
    table?.axes.forEach((axis, i) => {
      const cells = rows[i];
      if (!cells) return;
      put(cells[0], fixed(axis.angle, 4));
      put(cells[1], fixed(axis.rate, 3));
      put(cells[2], fixed(axis.error, 1));
      put(cells[3], axis.fault ? `✗ ${axis.state}` : axis.state);
      cells[3].className = axis.fault ? "bad" : "";
    });
    if (!imu) return;
    for (const [key] of COUNTS) {
      put(shown[key], String(imu[key] ?? "—"));
      shown[key].className = GRAVE.has(key) && imu[key] > 0 ? "care" : "";
    }
    const warm = Number.isFinite(imu.temperature) ? `${fixed(imu.temperature, 1)} °C` : "—";
    put(shown.temperature, warm);
  }

  return { plan, state };
}

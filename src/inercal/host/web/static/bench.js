/** What the table and the IMU report. */

import { byId, make, put } from "./dom.js";
import { fixed } from "./format.js";

const COUNTS = [
  ["packets", "packets"],
  ["lost", "lost packets"],
  ["failed", "checksum errors"],
  ["thrown", "bytes discarded between packets"],
  ["samples", "samples with an angle"],
  ["no_angle", "samples without an angle (table polled too slowly)"],
];
const GRAVE = new Set(["lost", "failed", "no_angle"]);

const RPM = 6; // °/s
const ANGLES = [
  ["angle, °", (axis) => axis.angle, 4],
  ["rate, °/s", (axis) => axis.rate, 3],
  ["following error, ″", (axis) => axis.error, 1],
];
const RATES = [
  ["set rate, r/min", (axis, set) => set / RPM, 2],
  ["rate, r/min", (axis) => axis.rate / RPM, 2],
];

export function makeBench() {
  const [axes, facts] = ["axes", "imu-facts"].map(byId);
  let rows = [];
  let shows = ANGLES;
  const shown = {};
  for (const [key, words] of [...COUNTS, ["temperature", "temperature"]]) {
    shown[key] = make("dd", {}, "—");
    facts.append(make("div", {}, make("dt", {}, words), shown[key]));
  }

  function plan(message) {
    shows = message.spins ? RATES : ANGLES;
    const heads = ["Table", ...shows.map(([words]) => words), "state"];
    rows = message.axes.map(() => heads.slice(1).map(() => make("td", {}, "—")));
    axes.replaceChildren(
      make("thead", {}, make("tr", {}, ...heads.map((text) => make("th", { scope: "col" }, text)))),
      make("tbody", {}, ...message.axes.map((name, i) =>
        make("tr", {}, make("th", { scope: "row" }, name), ...rows[i]))),
    );
    for (const node of Object.values(shown)) put(node, "—");
  }

  function state({ table, imu, set_rate: set }) {
    table?.axes.forEach((axis, i) => {
      const cells = rows[i];
      if (!cells) return;
      shows.forEach(([, value, digits], k) => put(cells[k], fixed(value(axis, set), digits)));
      const last = cells[shows.length];
      put(last, axis.fault ? `✗ ${axis.state}` : axis.state);
      last.className = axis.fault ? "bad" : "";
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

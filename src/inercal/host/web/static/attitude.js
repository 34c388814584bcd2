/** The attitude of the body: from the table's angles, and from the IMU's readings only. */

import { byId, make, mark, put } from "./dom.js";
import { fixed, signed } from "./format.js";
import { draw } from "./solid.js";
import { calm } from "./theme.js";

const OFTEN = 30; // ms between two frames
const NEAR = 0.12; // s in which the picture approaches the latest attitude
const SAME = 1e-5; // difference of matrix elements that is too small to see
const JUMP = 1.2; // a larger difference is not motion but a new attitude
const ENDED = "Live estimation has stopped, and with it the attitude from the IMU.";
const WORDS = {
  waits: "The attitude from the IMU appears once the coefficients are estimated.",
  ended: `${ENDED} The last one is shown in grey.`,
  none: "With this method only the attitude of the table is shown.",
};
const DEGREES = 180 / Math.PI;
const STEEP = 80; // ° of pitch; beyond it, small attitude errors are large errors of roll and heading
const POLE = "Near ±90° of pitch, only the sum of roll and heading is defined. Look at the attitude "
  + "difference instead.";

export function makeAttitude(theme) {
  const [section, waits, numbers] = ["attitude", "attitude-waits", "attitude-numbers"].map(byId);
  const pole = byId("attitude-pole");
  const views = [["by-table", "table"], ["by-imu", "navigation"]].map(([id, key]) =>
    ({ canvas: byId(id), key, wanted: null, shown: null, stale: true }));
  const cells = {};
  let last = 0;
  let found = null; // the latest navigation result
  const redraw = () => views.forEach((view) => (view.stale = true));
  theme.changed.push(redraw);
  new ResizeObserver(redraw).observe(byId("by-table"));

  const row = (key, name, columns) => {
    cells[key] = Array.from({ length: columns }, (_, i) =>
      make("td", { class: columns === 2 && i === 1 && "navigated" }, "—"));
    return make("tr", {}, make("th", { scope: "row" }, name), ...cells[key]);
  };
  const table = (looks, heads, ...rows) => make("table", { class: looks },
    make("thead", {}, make("tr", {}, ...heads.map((head) =>
      make("th", { scope: "col", class: head === "IMU" && "navigated" }, head)))),
    make("tbody", {}, ...rows));
  numbers.append(
    table("numbers", ["°", "table", "IMU"],
      row("roll", "roll", 2), row("pitch", "pitch", 2), row("heading", "heading", 2)),
    table("numbers navigated", ["", "total", "east", "north", "up"],
      row("apart", "difference, ″", 4), row("velocity", "velocity, m/s", 4)),
    table("numbers navigated", ["strapdown matrix", "x", "y", "z"],
      row("c0", "east", 3), row("c1", "north", 3), row("c2", "up", 3)),
  );

  function plan() {
    for (const view of views) Object.assign(view, { wanted: null, shown: null, stale: true });
    found = null;
    numbers.hidden = true;
    put(pole, "");
    explain("waits");
  }

  function state({ attitude, live }) {
    if (attitude?.navigation) found = attitude;
    // Some methods estimate too few coefficients for navigation.
    explain(live === "on" && attitude && !attitude.navigation ? "none" : live);
    if (!attitude) return;
    // The last result stays visible, greyed out, when navigation has stopped.
    const both = live === "ended" && found ? { ...found, table: attitude.table } : attitude;
    for (const view of views) {
      view.wanted = both[view.key] ?? null;
      view.stale = true;
    }
    say(both);
  }

  function explain(live) {
    mark(section, "live", live ?? "on");
    const words = WORDS[live] ?? "";
    put(waits, live === "ended" && !found ? ENDED : words);
    waits.hidden = !words;
  }

  function say(attitude) {
    numbers.hidden = false;
    const table = angles(attitude.table);
    const steep = [table[1], attitude.pitch].some((pitch) => Math.abs(pitch) > STEEP);
    put(pole, steep ? POLE : "");
    ["roll", "pitch", "heading"].forEach((key, i) => {
      const defined = key === "pitch" || !steep;
      put(cells[key][0], angle(key, defined ? table[i] : NaN));
      put(cells[key][1], angle(key, defined ? attitude[key] : NaN));
    });
    for (const [key, places] of [["apart", 1], ["velocity", 3]]) {
      const along = attitude[key];
      put(cells[key][0], fixed(along ? Math.hypot(...along) : NaN, places));
      for (let i = 0; i < 3; i++) put(cells[key][i + 1], signed(along?.[i], places));
    }
    for (let i = 0; i < 3; i++) {
      for (let k = 0; k < 3; k++) {
        put(cells[`c${i}`][k], signed(attitude.navigation?.[3 * i + k], 6));
      }
    }
  }

  function frame(now) {
    if (now - last < OFTEN) return;
    const share = calm.matches ? 1 : 1 - Math.exp(-(now - last) / (1000 * NEAR));
    last = now;
    for (const view of views) {
      if (!view.stale) continue;
      view.stale = approach(view, share);
      draw(view.canvas, view.shown, theme);
    }
  }

  return { plan, state, frame };
}

/** An angle for display; a heading that rounds to a full turn is shown as north. */
function angle(key, value) {
  const text = fixed(value, 3);
  return key === "heading" && text === "360.000" ? "0.000" : text;
}

/** Move the shown attitude toward the wanted one; true until it is reached. */
function approach(view, share) {
  const { wanted, shown } = view;
  if (!wanted || !shown || share > 0.99) {
    view.shown = wanted && [...wanted];
    return false;
  }
  let most = 0;
  for (let i = 0; i < 9; i++) most = Math.max(most, Math.abs(wanted[i] - shown[i]));
  if (most < SAME || most > JUMP) {
    for (let i = 0; i < 9; i++) shown[i] = wanted[i];
    return false;
  }
  for (let i = 0; i < 9; i++) shown[i] += share * (wanted[i] - shown[i]);
  square(shown);
  return true;
}

/** Make the columns orthonormal again. */
function square(c) {
  for (let k = 0; k < 2; k++) {
    if (k) {
      const along = c[0] * c[1] + c[3] * c[4] + c[6] * c[7];
      for (let i = 0; i < 9; i += 3) c[i + 1] -= along * c[i];
    }
    const length = Math.hypot(c[k], c[3 + k], c[6 + k]);
    for (let i = 0; i < 9; i += 3) c[i + k] /= length;
  }
  c[2] = c[3] * c[7] - c[6] * c[4];
  c[5] = c[6] * c[1] - c[0] * c[7];
  c[8] = c[0] * c[4] - c[3] * c[1];
}

/** Roll, pitch and heading in °; the heading is that of the body's y axis, clockwise from north. */
function angles(c) {
  if (!c) return [NaN, NaN, NaN];
  const pitch = Math.asin(Math.max(-1, Math.min(1, c[7])));
  const heading = Math.atan2(c[1], c[4]);
  return [Math.atan2(-c[6], c[8]) * DEGREES, pitch * DEGREES, ((heading * DEGREES) + 360) % 360];
}

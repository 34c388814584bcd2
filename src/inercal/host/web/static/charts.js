/** The six channels: accelerometers and gyros, each with x, y, z, over the last ten seconds. */

import { makeChart } from "./chart.js";
import { byId, put } from "./dom.js";
import { Playhead } from "./playhead.js";
import { Ring } from "./ring.js";
import { calm } from "./theme.js";

const LEGEND = 250; // ms between values that are read as numbers
const PIECE = 400; // ms: smaller pieces are drawn several at a time

export function makeCharts(theme) {
  const head = new Playhead();
  const resized = new ResizeObserver(() => charts.forEach((one) => one.fit(head.at, span)));
  const inSight = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) target.visible = isIntersecting;
  });
  let ring = null;
  let charts = [];
  let span = 10; // s that are in sight
  let read = 0;
  let fresh = false; // what came is not drawn yet
  let taken = 0; // ms: when it was
  let until = 0; // s: how far
  theme.changed.push(() => charts.forEach((one) => one.recolour()));

  function plan({ channels }) {
    for (const one of charts) one.end();
    resized.disconnect();
    inSight.disconnect();
    head.clear();
    ring = new Ring(channels.length);
    charts = [...document.querySelectorAll(".chart")].map((box) => {
      const own = channels.map((channel, i) => ({ ...channel, i }))
        .filter(({ measures }) => measures === box.dataset.measures);
      box.hidden = !own.length;
      if (!own.length) return null;
      const place = box.querySelector(".plot");
      resized.observe(place);
      inSight.observe(place);
      return makeChart(box, own, ring, theme);
    }).filter(Boolean);
    put(byId("window"), "");
  }

  function samples({ t, y, every }) {
    if (!ring || !t?.length) return;
    ring.append(t, y);
    head.hear(t.at(-1), performance.now());
    fresh = true;
    const means = every > 1 ? `, means of ${every} samples` : "";
    put(byId("window"), `last ${span} s${means}`);
  }

  /** A bench that is sped up has more of the recording in as much of the wall's time. */
  function state({ speed }) {
    span = speed > 1.5 ? 10 * round(speed) : 10;
  }

  /** Draw what came, once; then move it along. Return 1 when the picture changed. */
  function frame(now) {
    if (!ring?.end) return 0;
    const moved = head.move(now);
    const due = fresh && (now - taken > PIECE || head.at > until);
    if (!due && (!moved || calm.matches)) return 0;
    if (due) [fresh, taken, until] = [false, now, head.newest];
    if (now - read > LEGEND) {
      read = now;
      for (const one of charts) one.tell(head.at);
    }
    let changed = 0;
    for (const one of charts) {
      if (due) one.take(head.at, span);
      changed |= one.move(head.at);
    }
    return changed;
  }

  return { plan, samples, state, frame };
}

/** A number near to another one: 1, 2, 5, 10, 20 … */
function round(x) {
  const power = 10 ** Math.floor(Math.log10(x));
  const lead = x / power;
  return power * (lead < 1.5 ? 1 : lead < 3.5 ? 2 : lead < 7.5 ? 5 : 10);
}

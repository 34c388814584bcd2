/** The six channels in the last ten seconds: accelerometers and gyros, each with x, y and z. */

import { makeChart } from "./chart.js";
import { byId, put } from "./dom.js";
import { instant } from "./format.js";
import { Playhead } from "./playhead.js";
import { makeZoom, zoomButtons } from "./plot.js";
import { Ring } from "./ring.js";
import { calm } from "./theme.js";

const OFTEN = 32; // ms between two frames, on average
const CALM = 400; // ms between two frames if the device asks for reduced motion
const HEIGHTS = [110, 214]; // px: smallest and largest height of a plot
const BESIDE = 548; // px of a window's height for header, table and latest events, above and below both plots

export function makeCharts(theme, marks) {
  const head = new Playhead();
  const tools = byId("readings-zoom");
  const inSight = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) target.visible = isIntersecting;
    stale = true;
  });
  let ring = null;
  let charts = [];
  let span = 10; // visible time range, s
  let every = 1;
  let due = 0; // ms: time of the next frame
  let stale = false;

  tools.append(...zoomButtons("Last 10 s"));
  const zoom = makeZoom(tools, {
    limits: () => [ring?.end ? ring.time[0] : 0, head.newest],
    normal: () => [Math.max(head.at, span) - span, Math.max(head.at, span)],
    changed: () => (stale = true),
  });
  for (const source of [theme, marks]) source.changed.push(() => (stale = true));
  new ResizeObserver(() => (stale = true)).observe(byId("channels"));

  function plan({ channels }) {
    for (const one of charts) one.end();
    inSight.disconnect();
    head.clear();
    zoom.reset();
    ring = new Ring(channels.length);
    const height = Math.min(Math.max((innerHeight - BESIDE) / 2, HEIGHTS[0]), HEIGHTS[1]);
    charts = [...document.querySelectorAll(".chart")].map((box) => {
      const own = channels.map((channel, i) => ({ ...channel, i }))
        .filter(({ measures }) => measures === box.dataset.measures);
      box.hidden = !own.length;
      if (!own.length) return null;
      const made = makeChart(box, own, ring, { theme, marks, zoom, height });
      inSight.observe(made.place);
      return made;
    }).filter(Boolean);
    put(byId("window"), "");
  }

  function samples(message) {
    if (!ring || !message.t?.length) return;
    ring.append(message.t, message.y);
    head.hear(message.t.at(-1), performance.now());
    every = message.every;
    stale = true;
  }

  /** An accelerated bench produces more recording time in the same wall time. */
  function state({ speed }) {
    span = speed > 1.5 ? 10 * round(speed) : 10;
  }

  /** Advance and draw the visible range; return 1 if the picture changed. */
  function frame(now) {
    const pause = calm.matches ? CALM : OFTEN;
    if (!ring?.end || now < due) return 0;
    const moved = head.move(now) && !zoom.zoomed;
    if (!stale && !moved) return 0;
    // After a late frame, the next one comes sooner.
    [stale, due] = [false, Math.max(due, now - pause) + pause];
    const [from, to] = zoom.shown;
    const means = every > 1 ? `, means of ${every} samples` : "";
    const last = `last ${span} s`;
    put(byId("window"), (zoom.zoomed ? `${instant(from, to - from)} to ${instant(to, to - from)}` : last) + means);
    put(tools.lastChild, `Last ${span} s`);
    const seen = charts.filter(({ place }) => place.visible);
    for (const one of seen) one.draw(from, to);
    return seen.length ? 1 : 0;
  }

  /** Show the readings at a time, if they are still available. */
  function showTime(time) {
    if (!ring?.end || time < ring.time[0] || time > head.newest) return false;
    zoom.set(time - 5, time + 5);
    const [from, to] = zoom.shown;
    for (const one of charts) one.draw(from, to);
    charts[0]?.pointAt(time);
    return true;
  }

  return { plan, samples, coarse: samples, state, frame, showTime };
}

/** The nearest round number: 1, 2, 5, 10, 20 … */
function round(x) {
  const power = 10 ** Math.floor(Math.log10(x));
  const lead = x / power;
  return power * (lead < 1.5 ? 1 : lead < 3.5 ? 2 : lead < 7.5 ? 5 : 10);
}

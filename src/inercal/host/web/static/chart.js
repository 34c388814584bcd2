/** One plot of the readings: up to three channels, with names at the ends of their lines. */

import { make, put, svg } from "./dom.js";
import { fixed } from "./format.js";
import { makePlot } from "./plot.js";
import { DASHES } from "./theme.js";

const TITLES = { f: "accelerometers", w: "gyros" };
const LETTERS = ["x", "y", "z"];
const CALMS = 20; // frames after which a range that is too wide becomes narrower
const APART = 13; // px between two letters

export function makeChart(box, channels, ring, { theme, marks, zoom, height }) {
  const [legend, place] = [box.querySelector(".legend"), box.querySelector(".plot")];
  const title = `${TITLES[box.dataset.measures]}, ${channels[0].unit}`;
  const values = channels.map(() => make("span", { class: "value" }, "—"));
  const said = make("span", { class: "small at" });
  legend.replaceChildren(make("strong", {}, title),
    ...channels.map(({ name }, k) =>
      make("span", { class: "series" }, swatch(k), make("span", {}, name), values[k])), said);
  const letters = channels.map((_, k) =>
    make("span", { class: `letter ${LETTERS[k % 3]}`, "aria-hidden": "true", hidden: true },
      LETTERS[k % 3]));
  place.replaceChildren(...letters);

  const range = { low: NaN, high: NaN, wide: 0 };
  let first = 0; // index in the ring of the first sample that is drawn
  let last = 0; // index after the last sample
  let pointed = false;
  const plot = makePlot(place, {
    label: `${title}: ${channels.map(({ name }) => name).join(", ")} over time`,
    height, theme, marks, zoom, said,
    range: () => [range.low, range.high],
    read: (k) => {
      pointed = k !== null;
      tell(k === null ? last - 1 : first + k);
    },
    series: channels.map((_, k) => ({
      stroke: () => theme[LETTERS[k % 3]],
      width: 1.5,
      points: { show: false },
      paths: (u, series, from, to) => path(u, series, from, to, DASHES[k % 3]),
    })),
  });

  /** Draw the visible samples from one time to another. */
  function draw(from, to) {
    first = Math.max(0, ring.from(from) - 1);
    last = Math.min(ring.from(to) + 1, ring.end);
    const own = channels.map(({ i }) => ring.values[i].subarray(first, last));
    follow(range, own);
    plot.draw([ring.time.subarray(first, last), ...own], from, to);
    if (!pointed) tell(last - 1);
    name();
  }

  function tell(k) {
    const places = Math.max(0, Math.min(8, 4 - Math.floor(Math.log10(range.high - range.low))));
    channels.forEach(({ i }, n) => put(values[n], fixed(ring.values[i][k], places)));
  }

  /** Name each line at its end; names move apart so that they do not overlap. */
  function name() {
    const ends = channels.map(({ i }, k) => ({ k, y: plot.y(ring.values[i][last - 1]) }))
      .sort((a, b) => a.y - b.y);
    for (let k = 1; k < ends.length; k++) ends[k].y = Math.max(ends[k].y, ends[k - 1].y + APART);
    const below = Math.max(0, ends.at(-1).y - (height - 30));
    for (const { k, y } of ends) {
      letters[k].hidden = !Number.isFinite(y);
      letters[k].style.transform = `translateY(${Math.round(y - below)}px)`;
    }
  }

  return { draw, place, pointAt: plot.pointAt, end: plot.end };
}

/**
 * Dash a line so that its dashes move with the data, and leave gaps where samples are missing.
 * `period` is a share of the visible range, and a share `drawn` of each period is drawn.
 */
function path(u, series, first, last, { period, drawn }) {
  const stroke = new Path2D();
  const [t, y] = [u.data[0], u.data[series]];
  const { x, y: vertical } = u.scales;
  const { left, top, width, height } = u.bbox;
  const span = x.max - x.min;
  const [wide, tall] = [width / span, height / (vertical.max - vertical.min)];
  const gap = last > first ? Math.max(0.04, (6 * (t[last] - t[first])) / (last - first)) : 1;
  let going = false;
  for (let i = first; i <= last; i++) {
    const on = Number.isFinite(y[i]) && (drawn === 1 || (t[i] / (period * span)) % 1 < drawn);
    if (on) {
      const [right, down] = [left + (t[i] - x.min) * wide, top + (vertical.max - y[i]) * tall];
      if (going && t[i] - t[i - 1] < gap) stroke.lineTo(right, down);
      else stroke.moveTo(right, down);
    }
    going = on;
  }
  return { stroke, fill: null, clip: null, band: null, gaps: null, flags: 0 };
}

/** Widen a range at once when values leave it; narrow it after a while. */
function follow(range, channels) {
  let [low, high] = [Infinity, -Infinity];
  for (const values of channels) {
    for (const y of values) {
      if (y < low) low = y;
      if (y > high) high = y;
    }
  }
  if (low > high) [low, high] = [0, 0]; // no values of these channels are known
  const span = Math.max(high - low, 0.02 * Math.max(Math.abs(low), Math.abs(high)), 1e-3);
  const inside = low >= range.low && high <= range.high;
  range.wide = inside && range.high - range.low > 2.2 * span ? range.wide + 1 : 0;
  if (inside && range.wide < CALMS) return;
  const margin = 0.15 * span + (span - (high - low)) / 2;
  Object.assign(range, { low: low - margin, high: high + margin, wide: 0 });
}

/** A short piece of the line for the legend. */
function swatch(k) {
  const size = { width: 28, height: 12, "aria-hidden": "true", class: `line ${LETTERS[k % 3]}` };
  const dash = { "stroke-width": 2, "stroke-dasharray": DASHES[k % 3].legend };
  const whole = svg("svg", size);
  whole.append(svg("line", { x1: 1, x2: 27, y1: 6, y2: 6, ...dash }));
  return whole;
}

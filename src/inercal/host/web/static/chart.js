/**
 * One chart of up to three channels, in two layers: a still one with the scale of the values, and
 * over it one with the lines, which is drawn when samples come, wider than what is in sight, and
 * then only moved: to draw all points anew for each picture of the screen keeps a core busy.
 */

import { make, put, svg } from "./dom.js";
import { fixed } from "./format.js";
import { DASHES } from "./theme.js";

const TITLES = { f: "accelerometers", w: "gyros" };
const LETTERS = ["x", "y", "z"];
const [HEIGHT, LEFT, RIGHT, BELOW, ABOVE] = [210, 62, 18, 24, 8]; // px; scale, letters, times
const MORE = 1.3; // times what is in sight is drawn
const CALMS = 20; // pieces after which a range that is too wide becomes narrower
const APART = 13; // px between letters

export function makeChart(box, channels, ring, theme) {
  const [legend, place] = [box.querySelector(".legend"), box.querySelector(".plot")];
  const title = TITLES[box.dataset.measures];
  const names = channels.map(({ name }) => name).join(", ");
  const values = channels.map(() => make("span", { class: "value" }, "—"));
  legend.replaceChildren(make("strong", {}, `${title}, ${channels[0].unit}`),
    ...channels.map(({ name }, k) =>
      make("span", { class: "series" }, swatch(k), make("span", {}, name), values[k])));
  const letters = channels.map((_, k) =>
    make("span", { class: `letter ${LETTERS[k % 3]}`, "aria-hidden": "true", hidden: true },
      LETTERS[k % 3]));
  const clip = make("div", { class: "moving" });
  place.replaceChildren(clip, ...letters);
  place.setAttribute("role", "img");
  place.setAttribute("aria-label", `${title}: ${names} over time`);

  const range = { low: NaN, high: NaN, wide: 0 };
  const view = { from: 0, span: 10, at: NaN }; // s: left end of what is drawn, what is in sight
  let missed = false; // what came while nobody could see it
  const inner = () => Math.max(place.clientWidth - LEFT - RIGHT, 100);
  const axis = { stroke: () => theme.muted, ticks: { show: false }, font: "12px system-ui" };
  const grid = { stroke: () => theme.band, width: 1 };
  const scales = { x: { time: false, auto: false }, y: { auto: false } };
  const common = { height: HEIGHT, legend: { show: false }, cursor: { show: false }, scales };
  const still = new uPlot({
    ...common,
    width: LEFT + inner() + RIGHT,
    padding: [ABOVE, RIGHT, BELOW, 0],
    axes: [{ show: false }, { ...axis, grid, size: LEFT }],
    series: [{}],
  }, [[0, 1]], place); // without data uPlot takes no scale from outside
  const lines = new uPlot({
    ...common,
    width: inner() * MORE,
    padding: [ABOVE, 0, 0, 0],
    axes: [
      { ...axis, grid, size: BELOW, values: (_u, ticks) => ticks.map((s) => `${+s.toFixed(2)} s`) },
      { show: false },
    ],
    series: [{}, ...channels.map((_, k) => ({
      stroke: () => theme[LETTERS[k % 3]],
      width: 1.5,
      points: { show: false },
      paths: (u, series, first, last) => path(u, series, first, last, DASHES[k % 3], view.span),
    }))],
  }, [[], ...channels.map(() => [])], clip);

  /** Draw what can be seen soon. */
  function take(at, span) {
    Object.assign(view, { from: at - span, span, at: NaN });
    missed = !place.visible;
    if (missed) return;
    const first = Math.max(0, ring.from(view.from) - 1);
    const own = channels.map(({ i }) => ring.values[i].subarray(first, ring.end));
    const [low, high] = [range.low, range.high];
    follow(range, own);
    const y = { min: range.low, max: range.high };
    lines.setData([ring.time.subarray(first, ring.end), ...own], false);
    lines.batch(() => {
      lines.setScale("x", { min: view.from, max: view.from + span * MORE });
      lines.setScale("y", y);
    });
    if (low !== range.low || high !== range.high) still.setScale("y", y);
  }

  /** Move the lines so that `at` is at the right edge; return 1 when that changed something. */
  function move(at) {
    if (!place.visible) return 0;
    if (missed) take(at, view.span);
    const ratio = devicePixelRatio;
    const px = Math.round(((at - view.span - view.from) / view.span) * inner() * ratio) / ratio;
    if (px === view.at) return 0;
    view.at = px;
    lines.root.style.transform = `translateX(${-px}px)`;
    return 1;
  }

  /** Say the values at the right edge, and name each line there. */
  function tell(at) {
    const last = Math.min(ring.from(at), ring.end - 1);
    const places = Math.max(0, Math.min(8, 4 - Math.floor(Math.log10(range.high - range.low))));
    const tall = (HEIGHT - ABOVE - BELOW) / (range.high - range.low);
    const ends = channels.map(({ i }, k) => {
      put(values[k], fixed(ring.values[i][last], places));
      return { k, y: ABOVE + (range.high - ring.values[i][last]) * tall };
    });
    ends.sort((a, b) => a.y - b.y);
    // Names that would lie on one another give way.
    for (let k = 1; k < ends.length; k++) ends[k].y = Math.max(ends[k].y, ends[k - 1].y + APART);
    const below = Math.max(0, ends.at(-1).y - (HEIGHT - BELOW));
    for (const { k, y } of ends) {
      letters[k].hidden = !Number.isFinite(y);
      letters[k].style.transform = `translateY(${Math.round(y - below)}px)`;
    }
  }

  function fit(at, span) {
    if (!place.clientWidth || still.width === LEFT + inner() + RIGHT) return;
    still.setSize({ width: LEFT + inner() + RIGHT, height: HEIGHT });
    lines.setSize({ width: inner() * MORE, height: HEIGHT });
    if (!ring.end) return;
    take(at, span);
    move(at);
  }

  return {
    take, move, tell, fit,
    recolour: () => [still, lines].forEach((plot) => plot.redraw(false)),
    end: () => [still, lines].forEach((plot) => plot.destroy()),
  };
}

/**
 * A line with dashes that stay with the data while it moves, and nothing where samples are missing.
 * `period` is a share of what is in sight, of which a share `drawn` is drawn.
 */
function path(u, series, first, last, { period, drawn }, span) {
  const stroke = new Path2D();
  const [t, y] = [u.data[0], u.data[series]];
  const { x, y: vertical } = u.scales;
  const { left, top, width, height } = u.bbox;
  const [wide, tall] = [width / (x.max - x.min), height / (vertical.max - vertical.min)];
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

/** Widen a range at once where values leave it; narrow it after a while. */
function follow(range, channels) {
  let [low, high] = [Infinity, -Infinity];
  for (const values of channels) {
    for (const y of values) {
      if (y < low) low = y;
      if (y > high) high = y;
    }
  }
  if (low > high) [low, high] = [0, 0]; // nothing is known of these channels
  const span = Math.max(high - low, 0.02 * Math.max(Math.abs(low), Math.abs(high)), 1e-3);
  const inside = low >= range.low && high <= range.high;
  range.wide = inside && range.high - range.low > 2.2 * span ? range.wide + 1 : 0;
  if (inside && range.wide < CALMS) return;
  const margin = 0.15 * span + (span - (high - low)) / 2;
  Object.assign(range, { low: low - margin, high: high + margin, wide: 0 });
}

/** A piece of the line for the legend. */
function swatch(k) {
  const size = { width: 28, height: 12, "aria-hidden": "true", class: `line ${LETTERS[k % 3]}` };
  const dash = { "stroke-width": 2, "stroke-dasharray": DASHES[k % 3].legend };
  const whole = svg("svg", size);
  whole.append(svg("line", { x1: 1, x2: 27, y1: 6, y2: 6, ...dash }));
  return whole;
}

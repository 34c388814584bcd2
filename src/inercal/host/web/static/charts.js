/** The six channels: accelerometers and gyros, each with x, y, z, over the last ten seconds. */

import { byId, make, put } from "./dom.js";
import { fixed } from "./format.js";
import { Playhead } from "./playhead.js";
import { Ring } from "./ring.js";
import { DASHES } from "./theme.js";

const TITLES = { f: "accelerometers", w: "gyros" };
const LETTERS = ["x", "y", "z"];
const LEGEND = 250; // ms between values that are read as numbers
const CALMS = 20; // pieces after which a range that is too wide becomes narrower
const HEIGHT = 210;

export function makeCharts(theme) {
  const head = new Playhead();
  const observer = new ResizeObserver((entries) => {
    for (const { target } of entries) target.chart?.fit();
  });
  const seenNow = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) target.visible = isIntersecting;
  });
  let ring = null;
  let charts = [];
  let window_ = 10;
  let read = 0;
  theme.changed.push(() => charts.forEach((one) => one.plot.redraw(false)));

  function plan({ channels }) {
    for (const one of charts) one.end();
    observer.disconnect();
    head.clear();
    ring = new Ring(channels.length);
    charts = [...document.querySelectorAll(".chart")].map((box) => {
      const own = channels.map((channel, i) => ({ ...channel, i }))
        .filter(({ measures }) => measures === box.dataset.measures);
      box.hidden = !own.length;
      if (!own.length) return null;
      const made = chart(box, own, ring, theme);
      const plot = box.querySelector(".plot");
      plot.chart = made;
      observer.observe(plot);
      seenNow.observe(plot);
      return made;
    }).filter(Boolean);
    put(byId("window"), "");
  }

  function samples({ t, y, every }) {
    if (!ring || !t?.length) return;
    ring.append(t, y);
    head.hear(t.at(-1), performance.now());
    window_ = head.window;
    const first = Math.max(0, ring.from(head.newest - 1.3 * window_ - 2 * head.piece) - 1);
    for (const one of charts) one.take(first);
    const means = every > 1 ? `, means of ${every} samples` : "";
    put(byId("window"), `last ${window_} s${means}`);
  }

  /** Draw what is seen; return 1 when something was drawn. */
  function frame(now) {
    if (!ring?.end || !head.move(now)) return 0;
    if (now - read > LEGEND) {
      read = now;
      for (const one of charts) one.tell();
    }
    let drawn = 0;
    for (const one of charts) drawn |= one.draw(head.at - window_, head.at);
    return drawn;
  }

  return { plan, samples, frame };
}

/** One chart of up to three channels. */
function chart(box, channels, ring, theme) {
  const [legend, place] = [box.querySelector(".legend"), box.querySelector(".plot")];
  const title = TITLES[box.dataset.measures];
  const unit = channels[0].unit;
  const values = channels.map(() => make("span", { class: "value" }, "—"));
  legend.replaceChildren(make("strong", {}, `${title}, ${unit}`), ...channels.map(({ name }, k) =>
    make("span", { class: "series" }, swatch(k), make("span", {}, name), values[k])));
  const range = { low: NaN, high: NaN, wide: 0 };
  const line = (k) => ({
    stroke: () => theme[LETTERS[k % 3]],
    width: 1.5,
    dash: DASHES[k % 3],
    points: { show: false },
    pxAlign: 0,
    gaps: (u, _i, _from, _to, none) => gapsOf(u, ring, none),
  });
  const axis = {
    stroke: () => theme.muted,
    grid: { stroke: () => theme.band, width: 1 },
    ticks: { show: false },
    font: "12px system-ui",
  };
  const options = {
    width: Math.max(place.clientWidth, 200),
    height: HEIGHT,
    legend: { show: false },
    cursor: { show: false },
    padding: [8, 18, 0, 0],
    scales: { x: { time: false, auto: false }, y: { auto: false } },
    axes: [
      { ...axis, size: 24, values: (_u, ticks) => ticks.map((s) => `${+s.toFixed(2)} s`) },
      { ...axis, size: 62 },
    ],
    series: [{}, ...channels.map((_, k) => line(k))],
    hooks: { draw: [(u) => letters(u, channels, ring, theme)] },
  };
  place.replaceChildren();
  place.setAttribute("role", "img");
  const names = channels.map(({ name }) => name).join(", ");
  place.setAttribute("aria-label", `${title}: ${names} over time`);
  const plot = new uPlot(options, channels.map(() => []).concat([[]]), place);

  return {
    plot,
    end: () => plot.destroy(),
    fit() {
      const width = place.clientWidth;
      if (width > 0 && width !== plot.width) plot.setSize({ width, height: HEIGHT });
    },
    /** Take what came in; `first` is where what can be seen begins. */
    take(first) {
      const own = channels.map(({ i }) => ring.values[i].subarray(first, ring.end));
      plot.setData([ring.time.subarray(first, ring.end), ...own], false);
      follow(range, own);
    },
    tell() {
      const places = 4 - Math.floor(Math.log10(range.high - range.low));
      channels.forEach(({ i }, k) =>
        put(values[k], fixed(ring.values[i][ring.end - 1], Math.max(0, Math.min(places, 8)))));
    },
    draw(from, to) {
      if (!place.visible) return 0;
      plot.batch(() => {
        plot.setScale("x", { min: from, max: to });
        if (plot.scales.y.min !== range.low || plot.scales.y.max !== range.high) {
          plot.setScale("y", { min: range.low, max: range.high });
        }
      });
      return 1;
    },
  };
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
  if (low > high) return;
  const span = Math.max(high - low, 0.02 * Math.max(Math.abs(low), Math.abs(high)), 1e-3);
  const inside = low >= range.low && high <= range.high;
  range.wide = inside && range.high - range.low > 2.2 * span ? range.wide + 1 : 0;
  if (inside && range.wide < CALMS) return;
  const margin = 0.15 * span + (span - (high - low)) / 2;
  Object.assign(range, { low: low - margin, high: high + margin, wide: 0 });
}

/** Where samples are missing no line is drawn, as uPlot wants it: pixels from, to. */
function gapsOf(u, ring, none) {
  if (!ring.gaps.length) return none;
  const { min, max } = u.scales.x;
  const seen = ring.gaps.filter(([from, to]) => to > min && from < max);
  return seen.map(([from, to]) => [u.valToPos(from, "x", true), u.valToPos(to, "x", true)]);
}

/** Name each line at its right end; names that would lie on one another give way. */
function letters(u, channels, ring, theme) {
  const last = Math.min(ring.from(u.scales.x.max), ring.end) - 1;
  if (last < 0) return;
  const { ctx, bbox } = u;
  const ratio = devicePixelRatio;
  const apart = 13 * ratio;
  const at = channels.map(({ name, i }, k) => ({ k, letter: LETTERS[k % 3] ?? name,
    y: u.valToPos(ring.values[i][last], "y", true) })).filter(({ y }) => Number.isFinite(y));
  at.sort((a, b) => a.y - b.y);
  for (let i = 1; i < at.length; i++) at[i].y = Math.max(at[i].y, at[i - 1].y + apart);
  const below = at.length ? at.at(-1).y - (bbox.top + bbox.height) : 0;
  for (const one of at) if (below > 0) one.y -= below;
  ctx.save();
  ctx.font = `600 ${13 * ratio}px system-ui`;
  ctx.textBaseline = "middle";
  ctx.textAlign = "left";
  for (const { k, letter, y } of at) {
    ctx.fillStyle = theme[LETTERS[k % 3]];
    ctx.fillText(letter, bbox.left + bbox.width + 5 * ratio, y);
  }
  ctx.restore();
}

/** A piece of the line, as it is drawn. */
function swatch(k) {
  const of = (tag, attributes) => {
    const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
    return node;
  };
  const svg = { width: 28, height: 12, "aria-hidden": "true", class: `line ${LETTERS[k % 3]}` };
  const dash = { "stroke-width": 2, "stroke-dasharray": DASHES[k % 3].join(" ") };
  const whole = of("svg", svg);
  whole.append(of("line", { x1: 1, x2: 27, y1: 6, y2: 6, ...dash }));
  return whole;
}

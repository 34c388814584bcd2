/**
 * A plot over run time, with the features that all plots share: a time scale like that of the header
 * and the events, marks for events, a cursor that shows the values at a time, and a zoom by
 * dragging.
 */

import { make, put } from "./dom.js";
import { instant, minus } from "./format.js";

const SMALL = 3; // px; a shorter drag counts as a click
const NEAR = 6; // px from a mark within which the cursor shows its event
const STEP = [1, 10]; // points by which an arrow key moves the cursor, without and with the shift key
const ARROWS = { ArrowLeft: -1, ArrowRight: 1 };
const KEYS = { "+": "in", "=": "in", "-": "out", 0: "all" };
const LEVELS = { info: "faint", warning: "care", alarm: "bad" };
const FONT = "12px system-ui";
const CHARACTER = 7; // px per character
const TICKS = 4; // smallest number of visible ticks

/** As wide as the longest number on the scale, so that none is cut off. */
function scaleWidth(_u, values) {
  return 14 + CHARACTER * Math.max(4, ...(values ?? []).map((one) => one.length));
}

/**
 * Make a plot in `place`, a focusable element.
 *
 * `series` and `bands` are uPlot's, and `range(u, low, high)` returns the scale of the values.
 * `read(k)` is called with the index at the cursor, or null, when it changes. `said` is the element
 * that shows the time and the events at the cursor.
 */
export function makePlot(place, { label, height, series, bands, range, theme, marks, zoom, read, said }) {
  let own = null; // the uPlot object
  let shown = [0, 1]; // visible time range, s
  const width = () => place.clientWidth;

  place.setAttribute("role", "group");
  place.setAttribute("tabindex", "0");
  place.setAttribute("aria-label", `${label}. Arrows move the cursor; +, − and 0 zoom.`);
  place.addEventListener("keydown", keyed);
  place.addEventListener("blur", () => own?.setCursor({ left: -10, top: -10 }));
  new ResizeObserver(() => own && width() && own.setSize({ width: width(), height })).observe(place);
  theme.changed.push(() => own?.redraw(false));
  marks.changed.push(() => own?.redraw(false));

  const axis = { stroke: () => theme.muted, grid: { stroke: () => theme.band, width: 1 },
    ticks: { show: false }, font: FONT };

  function build(data) {
    own = new uPlot({
      width: width(), height,
      legend: { show: false },
      padding: [8, 26, 0, 0],
      cursor: {
        drag: { x: true, y: false, setScale: false, dist: SMALL },
        sync: { key: "time", scales: ["x", null] },
        points: { size: 6 },
        bind: { dblclick: () => () => zoom.reset() },
      },
      scales: { x: { time: false, auto: false, range: () => shown }, y: { range } },
      axes: [
        { ...axis, size: 26, space: 74, values: (_u, ticks) => ticks.map((s) =>
          instant(s, TICKS * (ticks[1] - ticks[0]))) },
        { ...axis, size: scaleWidth, values: (_u, ticks) => ticks.map((y) => minus(String(+y.toPrecision(9)))) },
      ],
      series: [{}, ...series],
      bands,
      hooks: { drawAxes: [drawMarks], setCursor: [tell], setSelect: [select] },
    }, data, place);
  }

  /** Draw rows of times and values from one time to another, s. */
  function draw(data, from, to) {
    if (!width()) return;
    shown = [from, to];
    if (!own) build(data);
    else own.setData(data);
    tell(own);
  }

  function select(u) {
    if (u.select.width <= SMALL) return;
    const [left, right] = [u.select.left, u.select.left + u.select.width];
    u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    zoom.set(u.posToVal(left, "x"), u.posToVal(right, "x"));
  }

  /** A line for each event, behind the data; warnings and alarms are coloured. */
  function drawMarks(u) {
    const pen = u.ctx;
    const { left, top, width: wide, height: tall } = u.bbox;
    const drawn = marks.between(...shown);
    place.dataset.marks = drawn.map(({ time }) => time).join(" ");
    for (const { time, level } of drawn) {
      const x = Math.round(left + ((time - shown[0]) / (shown[1] - shown[0])) * wide);
      pen.fillStyle = theme[LEVELS[level] ?? "faint"];
      pen.fillRect(x, top, devicePixelRatio * (level === "info" ? 1 : 2), tall);
      pen.fillRect(x - 3 * devicePixelRatio, top, 7 * devicePixelRatio, 4 * devicePixelRatio);
    }
  }

  /** Show the values at the cursor, and the events near it. */
  function tell(u) {
    const { left, idx } = u.cursor;
    const there = left >= 0 && idx != null;
    read(there ? idx : null);
    if (!there) return put(said, "");
    const at = u.data[0][idx];
    const pixel = (shown[1] - shown[0]) / (u.bbox.width / devicePixelRatio);
    const near = marks.between(at - NEAR * pixel, at + NEAR * pixel).map(({ words }) => words);
    put(said, `at ${instant(at, shown[1] - shown[0])}${near.length ? `: ${near.join("; ")}` : ""}`);
  }

  function point(k) {
    const at = own.data[0][Math.max(0, Math.min(own.data[0].length - 1, k))];
    own.setCursor({ left: own.valToPos(at, "x"), top: own.over.clientHeight / 2 });
  }

  function keyed(event) {
    if (!own || event.target !== place || event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.key in ARROWS && own.data[0].length) {
      const [first, last] = shown.map((at) => own.valToIdx(at));
      const from = own.cursor.left >= 0 ? own.cursor.idx : last + 1;
      const to = from + ARROWS[event.key] * STEP[+event.shiftKey];
      point(Math.max(first, Math.min(last, to)));
    } else if (event.key in KEYS) zoom[KEYS[event.key]]();
    else return;
    event.preventDefault();
  }

  /** Move the cursor to a time, if it is visible. */
  function pointAt(time) {
    // uPlot applies a new scale at the end of the task; until then positions follow the old one.
    if (own && time >= shown[0] && time <= shown[1]) queueMicrotask(() => point(own.valToIdx(time)));
  }

  return { draw, pointAt, get height() { return height; },
    y: (value) => (own ? own.valToPos(value, "y") + own.over.offsetTop : NaN),
    end: () => own?.destroy() };
}

/**
 * The visible time range: the whole range from `normal()`, or the zoomed one. The buttons in `tools`
 * do the same as dragging, because dragging with a finger scrolls the page.
 */
export function makeZoom(tools, { limits, normal, changed }) {
  let range = null;
  const [out, closer, all] = ["out", "in", "all"].map((what) => tools.querySelector(`[data-zoom=${what}]`));
  const LEAST = 0.05; // smallest visible range, s

  function set(from, to) {
    const [first, last] = limits();
    const half = Math.max(to - from, LEAST) / 2;
    const middle = (from + to) / 2;
    range = [Math.max(first, middle - half), Math.min(last, middle + half)];
    if (!(range[1] > range[0])) range = null;
    show();
  }

  function scale(factor) {
    const [from, to] = zoom.shown;
    const [, last] = limits();
    // The latest samples stay visible if they were visible before.
    const middle = to >= last - 0.2 * (to - from) ? to - (factor * (to - from)) / 2 : (from + to) / 2;
    set(middle - (factor * (to - from)) / 2, middle + (factor * (to - from)) / 2);
  }

  function show() {
    all.setAttribute("aria-pressed", String(range === null));
    changed();
  }

  const zoom = {
    set,
    in: () => scale(0.5),
    out: () => scale(2),
    all: () => zoom.reset(),
    reset: () => {
      range = null;
      show();
    },
    get shown() { return range ?? normal(); },
    get zoomed() { return range !== null; },
  };
  out.addEventListener("click", zoom.out);
  closer.addEventListener("click", zoom.in);
  all.addEventListener("click", zoom.reset);
  return zoom;
}

/** The zoom buttons; `words` is the text for the state without zoom. */
export function zoomButtons(words) {
  const button = (what, shown, label) => make("button", { type: "button", "data-zoom": what,
    "aria-label": label, "aria-pressed": what === "all" && "true" }, shown);
  return [button("out", "−", "Zoom out"), button("in", "+", "Zoom in"), button("all", words, words)];
}

/**
 * A manual session: for each axis its lamps, set and actual values, their trend, and its commands.
 *
 * A jog lasts as long as a button or a key is held. During this time the page sends a message ten
 * times per second, and anything that distracts hand or eye ends the jog at once. The program that
 * drives the table checks these messages: it stops 0.3 s after the last one, whatever happens to
 * this page.
 */

import { allow, allowed, byId, make, mark, put } from "./dom.js";
import { fixed, minus, signed } from "./format.js";
import { going, say, seen } from "./live.js";
import { order, unsent } from "./notice.js";
import { makePlot, makeZoom, zoomButtons } from "./plot.js";
import { Ring } from "./ring.js";

const HOLD = 100; // ms between two messages about a held key
const HEIGHT = 136; // height of a trend, px
const SPAN = 30; // length of a trend, s
const LEAST = 0.002; // smallest visible range, °, so that servo noise does not fill the plot
const LAMPS = [
  ["servo", "servo on", "servo off", "good"],
  ["homed", "homed", "not homed", "good"],
  ["in_position", "in position", "not in position", "good"],
  ["moving", "moving", "at rest", "care"],
  ["low", "at limit −", "limit − free", "bad"],
  ["high", "at limit +", "limit + free", "bad"],
  ["fault", "fault", "no fault", "bad"],
];
const SHORT = { servo: "servo", homed: "homed", in_position: "in position", moving: "moving",
  low: "limit −", high: "limit +", fault: "fault" };
const SIGNS = { good: "●", care: "▶", bad: "✗" }; // of a lamp that is on, in addition to its colour
const DOES = { idle: "", home: "homing", go: "moving", jog: "jogging", stop: "stopping" };
const JOG_KEYS = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 };

export function makeManual(theme, marks) {
  const panel = byId("manual");
  let axes = []; // one entry for each axis, with its elements
  let ring = null;
  let limits = [];
  let unsupported = {};
  let stale = false;
  let press = null; // the press that is held: axis, number, timer, button
  let number = Date.now(); // number of a press; no number is used twice, even after a reload

  const said = make("p", { id: "manual-said", class: "care", role: "status" });
  const halt = make("button", { type: "button", class: "grave", id: "halt" }, "Halt all axes");
  const end = make("button", { type: "button", id: "end-manual" }, "End manual control");
  const tools = make("div", { class: "tools", role: "group", "aria-label": "Time range of the trends" },
    ...zoomButtons(`Last ${SPAN} s`));
  const places = make("div", { id: "manual-axes" });
  const hint = make("p", { class: "small", id: "jog-hint" }, "Hold a jog button, or focus it and hold "
    + "Space, Enter, ← or →. The axis turns while you hold it and stops when you let go.");
  const zoom = makeZoom(tools, {
    limits: () => (ring?.end ? [ring.time[0], newest()] : [0, 1]),
    normal: () => [Math.max(newest(), SPAN) - SPAN, Math.max(newest(), SPAN)],
    changed: redraw,
  });
  for (const source of [theme, marks]) source.changed.push(redraw);
  new ResizeObserver(redraw).observe(panel);

  halt.addEventListener("click", () => {
    release();
    if (!allowed(halt)) tell(halt.title);
    else if (!say({ do: "release", all: true })) tell(unsent());
  });
  end.addEventListener("click", () => {
    release();
    if (allowed(end)) order({ do: "abort" }, "Ending manual control …");
    else tell(end.title);
  });
  // Anything that distracts hand or eye.
  for (const [target, name] of [[window, "blur"], [window, "pagehide"], [window, "pointerup"],
    [window, "pointercancel"], [document, "visibilitychange"]]) target.addEventListener(name, release);

  const newest = () => (ring?.end ? ring.time[ring.end - 1] : 0);

  function redraw() {
    stale = true;
  }

  function plan(message) {
    release();
    const { manual } = message;
    mark(document.body, "manual", manual ? (message.channels.length ? "imu" : "table") : "no");
    for (const { plot } of axes) plot.end();
    axes = [];
    panel.replaceChildren();
    put(said, "");
    ring = null;
    if (!manual) return;
    ({ limits, unsupported } = manual);
    ring = new Ring(2 * message.axes.length);
    zoom.reset();
    axes = message.axes.map((name, i) => makeAxis(name, i));
    places.replaceChildren(...axes.map(({ node }) => node));
    panel.replaceChildren(make("div", { class: "manual-head" },
      make("div", { class: "buttons" }, halt, end), said, tools), places, hint);
    show();
  }

  function makeAxis(name, i) {
    const limit = limits[i];
    const axis = { name, lamps: {}, values: {} };
    const id = (what) => `${what}-${i}`;
    const lamps = make("ul", { class: "lamps", "aria-label": `Lamps of axis ${name}` },
      ...LAMPS.map(([key]) => {
        const lamp = make("li", { "data-lamp": key });
        axis.lamps[key] = lamp;
        return lamp;
      }));
    const value = (key, words, unit) => {
      axis.values[key] = make("dd", {}, "—");
      return make("div", {}, make("dt", {}, `${words}, ${unit}`), axis.values[key]);
    };
    const values = make("dl", { class: "facts" }, value("set", "set angle", "°"),
      value("angle", "actual angle", "°"), value("set_rate", "set rate", "°/s"),
      value("rate", "actual rate", "°/s"), value("error", "following error", "″"));
    const field = (key, words, start) => {
      axis[key] = make("input", { id: id(key), type: "text", inputmode: "decimal", value: start,
        autocomplete: "off", maxlength: "12", "aria-describedby": id("limits") });
      return make("label", {}, words, axis[key]);
    };
    const button = (key, words, label, act) => {
      axis[key] = make("button", { type: "button", "aria-label": label }, words);
      axis[key].addEventListener("click", () => (allowed(axis[key]) ? act() : tell(axis[key].title)));
      return axis[key];
    };
    const jog = (key, sign) => {
      const words = sign < 0 ? "Jog −" : "Jog +";
      axis[key] = make("button", { type: "button", class: "jog", "aria-label":
        `${words} axis ${name}, while held`, "aria-describedby": "jog-hint" }, words);
      hold(axis, axis[key], sign);
      return axis[key];
    };
    const rate = Math.min(5, limit.rate ?? 5);
    axis.does = make("span", { class: "small does" });
    axis.node = make("section", { class: "manual-axis", "aria-label": `Axis ${name}` },
      make("div", { class: "now" }, make("h3", {}, name, " ", axis.does), lamps, values),
      make("div", { class: "ask" },
        make("div", { class: "buttons" },
          button("servo", "Servo on", `Servo of axis ${name}`, () => ask({ what: "servo", axis: name, on: !axis.is?.servo })),
          button("home", "Home", `Home axis ${name}`, () => ask({ what: "home", axis: name })),
          jog("back", -1), jog("onward", 1)),
        make("div", { class: "fields" }, field("goal", "angle, °", "0"), field("pace", "rate, °/s", minus(String(rate))),
          button("go", "Go", `Go: axis ${name} to the angle`, () => go(axis))),
        make("p", { class: "small", id: id("limits") }, limitWords(limit))),
      make("div", { class: "trend" },
        make("div", { class: "legend" }, make("span", { class: "actual" }, "actual"),
          make("span", { class: "set" }, "set"), make("span", { class: "small" }, "angle, °"),
          (axis.at = make("span", { class: "small value-at" })), (axis.said = make("span", { class: "small at" }))),
        (axis.place = make("div", { class: "plot" }))));
    axis.range = [-1, 1];
    axis.plot = makePlot(axis.place, {
      label: `Set and actual angle of axis ${name}, ° over time`, height: HEIGHT, theme, marks, zoom,
      said: axis.said,
      range: () => axis.range,
      read: (k) => put(axis.at, k === null || !ring ? ""
        : `actual ${fixed(ring.values[2 * i][axis.first + k], 4)}, set ${fixed(ring.values[2 * i + 1][axis.first + k], 4)}`),
      series: [{ stroke: () => theme.accent, width: 1.8, points: { show: false } },
        { stroke: () => theme.care, width: 1.5, dash: [6, 4], points: { show: false } }],
    });
    return axis;
  }

  /** A button that is held, by a finger, the mouse or a key. */
  function hold(axis, button, sign) {
    button.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      button.focus(); // not every browser focuses a clicked button
      begin(axis, button, sign);
    });
    for (const name of ["pointerup", "pointercancel", "pointerleave", "blur"]) button.addEventListener(name, release);
    button.addEventListener("contextmenu", (event) => event.preventDefault()); // a finger that holds
    button.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      const way = event.key === " " || event.key === "Enter" ? sign : JOG_KEYS[event.key];
      if (!way) return;
      event.preventDefault();
      if (!event.repeat) begin(axis, way < 0 ? axis.back : axis.onward, way);
    });
    button.addEventListener("keyup", release);
  }

  function begin(axis, button, sign) {
    release();
    if (!allowed(button)) return tell(button.title);
    const rate = typed(axis.pace);
    if (!(rate > 0)) return tell(`Axis ${axis.name}: enter the rate in °/s, above 0.`);
    number += 1;
    if (!ask({ what: "jog", axis: axis.name, rate: sign * rate, press: number })) return;
    press = { number, button };
    press.timer = setInterval(() => {
      if (!seen.people.yours || !say({ do: "manual", ask: { what: "hold", press: press.number } })) release();
    }, HOLD);
    button.classList.add("held");
  }

  function release() {
    if (!press) return;
    clearInterval(press.timer);
    press.button.classList.remove("held");
    press = null;
    say({ do: "release" });
  }

  function go(axis) {
    const [angle, rate] = [typed(axis.goal), typed(axis.pace)];
    if (!Number.isFinite(angle)) return tell(`Axis ${axis.name}: enter the angle in degrees.`);
    if (!(rate > 0)) return tell(`Axis ${axis.name}: enter the rate in °/s, above 0.`);
    ask({ what: "go", axis: axis.name, angle, rate });
  }

  function ask(what) {
    put(said, "");
    const sent = say({ do: "manual", ask: what });
    if (!sent) tell(unsent());
    return sent;
  }

  function tell(words) {
    put(said, words);
  }

  /** The history before this page was opened, newest first: rows of time, angles, set angles. */
  function trend({ points }) {
    if (!ring || !points.length) return;
    const rows = axes.flatMap((_, i) => [1, 2].map((which) => points.map((point) => point[which][i])));
    ring.prepend(points.map(([time]) => time), rows);
    redraw();
  }

  function state(message) {
    if (!ring || !message.manual) return;
    const now = message.table?.axes ?? [];
    if (now.length === axes.length) {
      ring.append([message.time], now.flatMap(({ angle }, i) => [[angle], [message.manual[i].set]]));
      redraw();
    }
    message.manual.forEach((is, i) => {
      const axis = axes[i];
      if (!axis) return;
      axis.is = is;
      for (const [key, lit, dark, tone] of LAMPS) {
        const lamp = axis.lamps[key];
        mark(lamp, "lit", is[key] ? tone : "no");
        put(lamp, `${is[key] ? SIGNS[tone] : "○"} ${SHORT[key]}`);
        lamp.setAttribute("aria-label", is[key] ? lit : dark);
      }
      put(axis.values.set, fixed(is.set, 4));
      put(axis.values.angle, fixed(now[i]?.angle, 4));
      put(axis.values.set_rate, is.activity === "jog" ? signed(is.set_rate, 3) : fixed(is.set_rate, 3));
      put(axis.values.rate, fixed(now[i]?.rate, 3));
      put(axis.values.error, fixed(now[i]?.error, 1));
      put(axis.does, now[i]?.fault ? `✗ ${now[i].state}` : DOES[is.activity] ?? "");
      axis.does.classList.toggle("bad", Boolean(now[i]?.fault));
      put(axis.servo, is.servo ? "Servo off" : "Servo on");
    });
    show();
  }

  /** Update which commands are possible now, and why the others are not. */
  function show() {
    const why = !going() ? "manual control has ended"
      : seen.link !== "live" ? "this page shows old data"
      : !seen.people.yours ? "only the operator can do this: take control first" : "";
    const mayStop = !going() ? why : !seen.people.yours ? why : "";
    allow(halt, !mayStop, mayStop);
    allow(end, !mayStop, mayStop);
    for (const axis of axes) {
      const is = axis.is ?? {};
      const moves = is.activity && is.activity !== "idle";
      const servo = is.servo && unsupported.servo ? unsupported.servo : is.servo && moves ? "the axis is moving" : "";
      const ready = !is.servo ? "its servo is off" : is.activity === "home" ? "it is homing" : "";
      const reasons = { servo, home: unsupported.home || ready, go: ready || (is.homed ? "" : "home it first"),
        back: ready || (is.low ? "it is at its − limit" : ""), onward: ready || (is.high ? "it is at its + limit" : "") };
      for (const [key, own] of Object.entries(reasons)) {
        const reason = why || own;
        allow(axis[key], !reason, reason && `Axis ${axis.name}: ${reason}.`);
      }
    }
  }

  /** Show refusals and stops next to the control that they belong to. */
  function event({ level, words }) {
    if (ring && (level === "warning" || level === "alarm")) tell(words);
  }

  function frame() {
    if (!stale || !ring?.end) return;
    stale = false;
    const [from, to] = zoom.shown;
    const first = Math.max(0, ring.from(from) - 1);
    const last = Math.min(ring.from(to) + 1, ring.end);
    axes.forEach((axis, i) => {
      axis.first = first;
      const rows = [ring.values[2 * i], ring.values[2 * i + 1]].map((row) => row.subarray(first, last));
      axis.range = rangeOf(rows);
      axis.plot.draw([ring.time.subarray(first, last), ...rows], from, to);
    });
  }

  /** Show the values at a session time, if they are still available. */
  function showTime(time) {
    if (!ring?.end || time < ring.time[0] || time > newest()) return false;
    zoom.set(time - 5, time + 5);
    stale = true;
    frame();
    for (const { plot } of axes) plot.pointAt(time);
    return true;
  }

  function ends() {
    release();
    put(said, "");
    for (const { does } of axes) put(does, "");
    show();
  }

  function leave() {
    release();
    mark(document.body, "manual", "no");
  }

  return { plan, state, trend, event, frame, showTime, done: ends, idle: leave,
    people: () => {
      if (!seen.people.yours) release();
      show();
    },
    link: () => {
      if (seen.link !== "live") release();
      show();
    } };
}

/** Parse a typed number; NaN if it is not a number. */
function typed(field) {
  const text = field.value.trim().replace(",", ".").replace("\u2212", "-");
  return /^[+-]?(\d+\.?\d*|\.\d+)$/.test(text) ? Number(text) : NaN;
}

function limitWords({ rate, low, high }) {
  const ends = Number.isFinite(low) || Number.isFinite(high)
    ? `${Number.isFinite(low) ? fixed(low, 1) : "−∞"} to ${Number.isFinite(high) ? fixed(high, 1) : "∞"} °` : "no soft limits";
  return `Limits: ${ends}; ${Number.isFinite(rate) ? `up to ${minus(String(+rate.toPrecision(6)))} °/s` : "no rate limit"}`;
}

/** The range of all visible values. */
function rangeOf(rows) {
  let [low, high] = [Infinity, -Infinity];
  for (const row of rows) {
    for (const y of row) {
      if (y < low) low = y;
      if (y > high) high = y;
    }
  }
  if (low > high) return [-1, 1];
  const span = Math.max(high - low, LEAST);
  const middle = (low + high) / 2;
  return [middle - 0.6 * span, middle + 0.6 * span];
}

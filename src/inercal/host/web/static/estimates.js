/** The live estimates by kind and axis, each with a small plot of how its ±2σ decreased. */

import { byId, make, mark, put, svg } from "./dom.js";
import { digits, fixed } from "./format.js";
import { History } from "./history.js";

const KINDS = { f: "accelerometers", w: "gyros" };
const PARTS = { ...KINDS, all: "all axes" }; // parts of the sensor that are estimated separately
const WORDS = {
  waits: "No estimates yet: the method needs more samples.",
  ended: "Live estimation has stopped; the grey values are the last ones. The recording is complete: "
    + "the results are computed from it at the end.",
  none: "This method estimates nothing during the run: the results are computed at the end.",
};
const NIS = "normalised innovation squared";
const NIS_MEANING = "Squared innovation divided by its stated variance: about 1 if noise and bench are as stated";
export const SIGNS = { good: "✓", care: "▲", bad: "✗" }; // shown in addition to the colours
const DECADES = 3; // decades of decrease from the top to the bottom of a small plot
const POINTS = 100; // points in a small plot
const OFTEN = 300; // ms between two frames

/** A term with a link to its definition. */
function term(shown, name, meaning) {
  const anchor = name.toLowerCase().replace(/[^a-z0-9]+/g, "-");
  return make("a", { class: "term", href: `/glossary#term-${anchor}`, target: "_blank",
    title: meaning }, shown);
}

export function makeEstimates(course) {
  const [place, nis, waits] = ["coefficients", "nis", "waits"].map(byId);
  const sections = ["estimates", "course"].map(byId);
  const found = make("span", { class: "grades" });
  let cells = [];
  let history = null;
  let chosen = ""; // name of the chosen coefficient; the page keeps it when it reconnects
  let last = null; // the latest estimate
  let drawn = 0;
  let stale = false;
  let final = null; // values from the calibration file

  nis.prepend(make("p", {}, term("NIS", NIS, NIS_MEANING), " ", found));

  function plan({ coefficients }) {
    history = new History(coefficients.length);
    last = final = null;
    title(null);
    cells = coefficients.map(cell);
    const tables = Object.keys(KINDS).map((kind) => table(kind, coefficients));
    place.replaceChildren(...tables.filter(Boolean));
    grade(null);
    explain("waits");
    const before = cells.findIndex(({ coefficient }) => coefficient.name === chosen);
    choose(Math.max(before, 0), false);
  }

  /** The state of live estimation; estimates that are no longer updated are greyed out. */
  function state({ live }) {
    explain(live);
  }

  function explain(live) {
    for (const section of sections) mark(section, "live", live ?? "on");
    put(waits, WORDS[live] ?? "");
    waits.hidden = !WORDS[live];
  }

  /** A table with one row for each kind of coefficient and one column for each axis. */
  function table(kind, coefficients) {
    const all = coefficients.map((one, i) => ({ ...one, i }));
    const own = all.filter((one) => one.measures === kind);
    if (!own.length) return null;
    const axes = [...new Set(own.map(({ axis }) => axis))];
    const names = [...new Set(own.map((one) => one.own))];
    const rows = names.map((name) => {
      const of = (axis) => own.find((one) => one.axis === axis && one.own === name);
      const { unit, meaning, symbol } = own.find((one) => one.own === name);
      const head = make("th", { scope: "row" },
        term(name, `${KINDS[kind]}-${name}`, `${symbol ?? name}: ${meaning}`),
        make("span", { class: "small" }, ` ${unit}`), make("br"),
        make("span", { class: "small meaning" }, meaning));
      return make("tr", {}, head,
        ...axes.map((axis) => make("td", {}, of(axis) ? cells[of(axis).i].button : "")));
    });
    return make("div", { class: "scroll" }, make("table", { class: "estimates" },
      make("thead", {}, make("tr", {}, make("th", { scope: "col" }, KINDS[kind]),
        ...axes.map((axis) => make("th", { scope: "col" }, axis)))),
      make("tbody", {}, ...rows)));
  }

  function cell(coefficient, i) {
    const value = make("span", { class: "value" }, "—");
    const picture = svg("svg", { viewBox: "0 0 100 16", preserveAspectRatio: "none",
      "aria-hidden": "true" });
    const funnel = svg("path", { d: "" });
    picture.append(funnel);
    const button = make("button", { type: "button", class: "coefficient", tabindex: "-1",
      "aria-pressed": "false", "data-name": coefficient.name,
      title: `${coefficient.name}: ${coefficient.meaning}`,
      "aria-label": `${coefficient.name}: no estimate yet` }, value, picture);
    button.addEventListener("click", () => choose(i, true));
    button.addEventListener("keydown", (event) => move(event));
    return { button, value, funnel, coefficient };
  }

  function choose(i, focus) {
    if (!cells[i]) return course.choose?.(null, null, 0);
    chosen = cells[i].coefficient.name;
    cells.forEach(({ button }, k) => {
      button.setAttribute("aria-pressed", String(k === i));
      button.tabIndex = k === i ? 0 : -1;
    });
    if (focus) cells[i].button.focus();
    course.choose?.(cells[i].coefficient, history, i);
  }

  /** Move to the nearest cell in the direction of an arrow key. */
  function move(event) {
    const ways = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] };
    const way = ways[event.key];
    if (!way) return;
    event.preventDefault();
    const rows = [...place.querySelectorAll("tbody tr")];
    const row = rows.findIndex((one) => one.contains(event.currentTarget));
    const column = [...rows[row].cells].indexOf(event.currentTarget.parentNode);
    const next = rows[row + way[0]]?.cells[column + way[1]]?.querySelector("button");
    if (next) choose(cells.findIndex(({ button }) => button === next), true);
  }

  function estimates(message) {
    if (!history) return;
    if (history.add(message.time, message.values, message.u2)) last = message;
    stale = true;
  }

  /** A viewer who connects late gets hundreds of messages at once; only the last one is drawn. */
  function frame(now) {
    if (!stale || now - drawn < OFTEN) return;
    [stale, drawn] = [false, now];
    show();
  }

  /** Show the live estimate or, when it exists, the calibration file. */
  function show() {
    const { values, u2 } = final ?? last ?? { values: [], u2: [] };
    cells.forEach((one, i) => {
      const [value, spread] = digits(values[i] ?? NaN, u2[i] ?? NaN);
      const { name, unit } = one.coefficient;
      put(one.value, Number.isFinite(values[i]) ? `${value} ±\u00a0${spread}` : "—");
      one.button.setAttribute("aria-label", Number.isFinite(values[i])
        ? `${name}: ${value} ± ${spread} ${unit}` : `${name}: no estimate yet`);
      spark(one, i);
    });
    grade(last?.nis);
    course.redraw?.();
  }

  /** How well the innovations of each part agree with their stated size: colour, sign and word. */
  function grade(ratios) {
    const parts = Object.entries(PARTS).filter(([kind]) => Number.isFinite(ratios?.[kind]?.ratio));
    nis.hidden = !parts.length;
    found.replaceChildren(...parts.map(([kind, name]) => {
      const { ratio, level, words } = ratios[kind];
      return make("span", { class: `grade ${level}` },
        `${SIGNS[level] ?? ""} ${name} ${fixed(ratio, 2)}: ${words}`);
    }));
  }

  /** The end message has the values of the calibration file, in the order of its own names. */
  function done(message) {
    if (!message.final || !history) return;
    const at = cells.map(({ coefficient }) => message.final.names.indexOf(coefficient.name));
    const row = (key) => at.map((k) => message.final[key][k] ?? null);
    final = { values: row("values"), u2: row("u2") };
    title(final);
    stale = true;
    if (sections[0].dataset.live !== "none") return;
    // Nothing was estimated live, but the results are available now.
    mark(sections[0], "live", "on");
    waits.hidden = true;
  }

  function title(results) {
    put(byId("estimates-title").firstChild, results ? "Results " : "Estimates ");
    put(byId("estimates-what"), results ? "from the calibration file: value ± U, k = 2"
      : "live: value ± 2σ");
  }

  /** Half the width of the band is 2σ on a logarithmic scale: a third of the height per factor of ten. */
  function spark({ funnel }, i) {
    const { size, time } = history;
    const spread = history.spread[i];
    let first = 0;
    while (first < size && !(spread[first] > 0)) first += 1;
    const last = size - 1;
    if (last <= first) return funnel.setAttribute("d", "");
    const stride = Math.max(1, Math.floor((size - first) / POINTS));
    const over = [];
    const under = [];
    for (let k = first; ; k = Math.min(k + stride, last)) {
      const x = ((100 * (time[k] - time[first])) / (time[last] - time[first])).toFixed(1);
      const lost = Math.log10(spread[first] / spread[k]) / DECADES;
      const half = Math.max(0.6, 8 * Math.min(1, 1 - lost || 0));
      over.push(`${x} ${(8 - half).toFixed(1)}`);
      under.push(`${x} ${(8 + half).toFixed(1)}`);
      if (k === last) break;
    }
    funnel.setAttribute("d", `M${over.join("L")}L${under.reverse().join("L")}Z`);
  }

  return { plan, state, estimates, done, frame };
}

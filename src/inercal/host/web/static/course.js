/** The chosen coefficient over the whole run, with its ±2σ. */

import { byId, make, put } from "./dom.js";
import { digits } from "./format.js";
import { makePlot, makeZoom, zoomButtons } from "./plot.js";

const HEIGHT = 210;
const CLOSE = 6; // times the present 2σ to both sides, in a close-up

export function makeCourse(theme, marks) {
  const [place, title, legend, tools] = ["course-plot", "course-title", "course-legend", "course-zoom"].map(byId);
  const [closeUp, whole] = ["close-up", "whole"].map(byId);
  const edge = { stroke: () => theme.accent, width: 1, dash: [4, 3], points: { show: false } };
  let [coefficient, history, index, close] = [null, null, 0, true];
  let rows = [];
  let first = 0; // index of the first known value in the history
  let stale = false;
  const value = make("span", { class: "value" });
  const said = make("span", { class: "small at" });

  legend.append(value, said);
  tools.append(...zoomButtons("Whole run"));
  const zoom = makeZoom(tools, {
    limits: () => (history?.size ? [history.time[first], history.time[history.size - 1]] : [0, 1]),
    normal: () => [history.time[first], Math.max(history.time[history.size - 1], history.time[first] + 1)],
    changed: redraw,
  });
  const plot = makePlot(place, {
    label: "The chosen coefficient over time", height: HEIGHT, theme, marks, zoom, said,
    range: (_u, low, high) => range(low, high),
    read: tell,
    series: [{ stroke: () => theme.ink, width: 1.8, points: { show: false } }, edge, edge],
    bands: [{ series: [3, 2], fill: () => `${theme.accent}38` }],
  });
  for (const [button, which] of [[closeUp, true], [whole, false]]) {
    button.addEventListener("click", () => {
      close = which;
      closeUp.setAttribute("aria-pressed", String(close));
      whole.setAttribute("aria-pressed", String(!close));
      redraw();
    });
  }
  new ResizeObserver(redraw).observe(place);

  function redraw() {
    stale = true;
  }

  function frame() {
    if (!stale) return;
    stale = false;
    draw();
  }

  /** In a close-up the scale follows the present 2σ; early, much wider estimates are cut off. */
  function range(low, high) {
    const last = history ? history.size - 1 : -1;
    const middle = last < 0 ? NaN : history.value[index][last];
    const spread = last < 0 ? NaN : history.spread[index][last];
    if (close && !zoom.zoomed && spread > 0) return [middle - CLOSE * spread, middle + CLOSE * spread];
    if (!(high > low)) return [(low ?? 0) - 1, (low ?? 0) + 1];
    const margin = 0.05 * (high - low);
    return [low - margin, high + margin];
  }

  function choose(one, from, i) {
    if (history !== from) zoom.reset();
    [coefficient, history, index] = [one, from, i];
    rows = from ? [0, 1].map(() => new Float64Array(from.time.length)) : [];
    put(title, one ? `${one.name} (${one.meaning}) over time, ${one.unit}` : "Estimate over time");
    redraw();
  }

  function tell(k) {
    if (!history) return;
    const at = k === null ? history.size - 1 : first + k;
    const [found, spread] = digits(history.value[index][at], history.spread[index][at]);
    put(value, coefficient && history.size ? `${found} ± ${spread} ${coefficient.unit}` : "");
  }

  function draw() {
    if (!coefficient || !history) return;
    const known = history.size > 0 && Number.isFinite(history.value[index][history.size - 1]);
    byId("course-waits").hidden = known;
    if (!known) return;
    const { time, size } = history;
    const [values, spreads] = [history.value[index], history.spread[index]];
    first = 0;
    while (first < size && !Number.isFinite(values[first])) first += 1;
    for (let k = first; k < size; k++) {
      rows[0][k] = values[k] + spreads[k];
      rows[1][k] = values[k] - spreads[k];
    }
    plot.draw([time, values, rows[1], rows[0]].map((row) => row.subarray(first, size)), ...zoom.shown);
  }

  return { choose, redraw, frame, showTime: plot.pointAt };
}

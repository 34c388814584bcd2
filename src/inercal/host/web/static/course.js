/** The course of the coefficient that was chosen, with its ±2σ. */

import { byId, put } from "./dom.js";

const HEIGHT = 240;
const CLOSE = 6; // times the present 2σ to both sides, in a close-up

export function makeCourse(theme) {
  const [place, title] = ["course-plot", "course-title"].map(byId);
  const [closeUp, whole] = ["close-up", "whole"].map(byId);
  const axis = { stroke: () => theme.muted, grid: { stroke: () => theme.band, width: 1 },
    ticks: { show: false }, font: "12px system-ui" };
  const edge = { stroke: () => theme.accent, width: 1, dash: [4, 3], points: { show: false } };
  let [coefficient, history, index, close] = [null, null, 0, true];
  let rows = [];
  let plot = null;

  place.setAttribute("role", "img");
  for (const [button, value] of [[closeUp, true], [whole, false]]) {
    button.addEventListener("click", () => {
      close = value;
      closeUp.setAttribute("aria-pressed", String(close));
      whole.setAttribute("aria-pressed", String(!close));
      draw();
    });
  }
  new ResizeObserver(() => {
    if (plot && place.clientWidth) plot.setSize({ width: place.clientWidth, height: HEIGHT });
    else draw();
  }).observe(place);
  theme.changed.push(() => plot?.redraw(false));

  function build() {
    return new uPlot({
      width: place.clientWidth,
      height: HEIGHT,
      legend: { show: false },
      cursor: { show: false },
      padding: [8, 12, 0, 0],
      scales: { x: { time: false }, y: { range: (_u, low, high) => range(low, high) } },
      axes: [
        { ...axis, size: 26, values: (_u, ticks) => ticks.map((s) => `${+s.toFixed(1)} s`) },
        { ...axis, size: 74 },
      ],
      series: [{}, { stroke: () => theme.ink, width: 1.8, points: { show: false } }, edge, edge],
      bands: [{ series: [3, 2], fill: () => `${theme.accent}38` }],
    }, [[], [], [], []], place);
  }

  /** In a close-up the scale follows the present 2σ: early guesses, much wider, are cut off. */
  function range(low, high) {
    const last = history ? history.size - 1 : -1;
    const value = last < 0 ? NaN : history.value[index][last];
    const spread = last < 0 ? NaN : history.spread[index][last];
    if (close && spread > 0) return [value - CLOSE * spread, value + CLOSE * spread];
    if (!(high > low)) return [(low ?? 0) - 1, (low ?? 0) + 1];
    const margin = 0.05 * (high - low);
    return [low - margin, high + margin];
  }

  function choose(one, from, i) {
    [coefficient, history, index] = [one, from, i];
    rows = from ? [0, 1].map(() => new Float64Array(from.time.length)) : [];
    put(title, one ? `Course of ${one.name}, ${one.unit}` : "Course");
    place.setAttribute("aria-label", one ? `Course of ${one.name} with its ±2σ` : "Course");
    draw();
  }

  function draw() {
    if (!coefficient || !place.clientWidth) return;
    plot ??= build();
    const { time, size } = history;
    const [value, spread] = [history.value[index], history.spread[index]];
    let first = 0;
    while (first < size && !Number.isFinite(value[first])) first += 1;
    for (let k = first; k < size; k++) {
      rows[0][k] = value[k] + spread[k];
      rows[1][k] = value[k] - spread[k];
    }
    plot.setData([time, value, rows[1], rows[0]].map((row) => row.subarray(first, size)));
  }

  return { choose, draw };
}

/** What is going on, in words: phase, time, connection. */

import { byId, put } from "./dom.js";
import { clock, fixed } from "./format.js";
import { age, going, quiet, seen } from "./live.js";

const PHASES = {
  enable: "switching the servos on",
  home: "homing: finding the zeros",
  mount: "waiting for the mounting of the sensor",
  approach: "going to where the step begins",
  work: "measuring",
  moves: "turning",
  holds: "holding",
  return: "returning to zero",
  manual: "operated by hand",
  paused: "paused",
  done: "all steps done",
  aborted: "stopped",
};
const LINKS = {
  connecting: "connecting …",
  live: "connected",
  silent: "no news",
  quiet: "no word",
  lost: "not connected",
};

export function makeHeader() {
  const header = document.querySelector("header");
  const [over, sensor, phase, time] = ["over", "sensor", "phase", "clock"].map(byId);
  const [link, lost, trouble, progress] = ["link", "lost", "trouble", "progress"].map(byId);

  // What the focus moves to is not scrolled to a place behind the header, whose height changes.
  new ResizeObserver(() => {
    document.documentElement.style.setProperty("--header", `${header.offsetHeight}px`);
  }).observe(header);

  function plan(message) {
    put(over, `${message.plan} · ${message.simulated ? "SIMULATED bench" : "real bench"}`);
    put(sensor, message.sensor);
    document.title = `${message.sensor} · inercal bench`;
    document.body.dataset.bench = message.simulated ? "simulated" : "iron";
    put(trouble, "");
    show();
  }

  function idle() {
    put(over, "live page of the bench");
    put(sensor, "Set up a run");
    document.title = "inercal bench";
    delete document.body.dataset.bench;
    put(trouble, "");
    show();
  }

  /** Phase and times by what was heard last. */
  function show() {
    put(phase, words());
    const state = seen.state;
    progress.hidden = !state;
    if (!state) return put(time, seen.plan ? `${clock(seen.plan.seconds)} planned` : "");
    const [gone, left] = [state.time, Math.max(state.remaining ?? 0, 0)];
    progress.value = seen.done?.state === "done" ? 1 : gone / Math.max(gone + left, 1e-9);
    const fast = state.speed > 1.5 ? ` · ${fixed(state.speed, 0)} × real time` : "";
    if (seen.plan?.manual) put(time, `${clock(gone)} since it began`);
    else put(time, `${clock(gone)} gone${seen.done ? "" : `, ${clock(left)} to go${fast}`}`);
    put(trouble, state.trouble && !seen.done ? `▲ ${state.trouble}` : "");
  }

  function connection() {
    const { link: now } = seen;
    link.dataset.link = now;
    put(link, LINKS[now]);
    const old = ["lost", "quiet"].includes(now) || (now === "silent" && going());
    document.body.classList.toggle("old", old);
    if (now === "lost") {
      put(lost, "Connection lost. What is shown is old, and STOP of this page cannot reach the "
        + "table: use the emergency stop. Trying again …");
    } else if (now === "quiet") {
      put(lost, `No word from the server for ${fives(quiet())} s or more: the connection may be `
        + "broken. What is shown is old, and STOP of this page may not reach the table: use the "
        + "emergency stop.");
    } else if (now === "silent" && going()) {
      const seconds = fives(age()) || 2;
      put(lost, `No news from the bench for ${seconds} s or more. What is shown is old.`);
    } else put(lost, "");
  }

  return {
    hello: () => put(byId("version"), `inercal ${seen.version}`),
    plan, idle, phase: show, state: show, done: show, link: connection,
  };
}

/** Read aloud each time that it differs: in steps of 5 s, of those that have gone. */
const fives = (seconds) => Math.floor(seconds / 5) * 5;

function words() {
  const { state, done } = seen;
  if (done) return done.state === "manual" ? "operation by hand has ended" : done.state;
  if (seen.phase) return seen.phase;
  if (!state) return seen.plan ? "beginning" : "";
  if (state.paused) return /^paused/.test(state.paused) ? state.paused : `paused: ${state.paused}`;
  const count = seen.plan?.steps.length ?? 0;
  const step = seen.plan?.steps[state.done];
  const doing = PHASES[state.phase] ?? state.phase;
  const inStep = step && !["enable", "home", "return", "done", "aborted"].includes(state.phase);
  return inStep ? `step ${state.done + 1} of ${count}: ${step.label}, ${doing}` : doing;
}

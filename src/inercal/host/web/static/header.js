/** The status as text: phase, time and connection. */

import { byId, mark, put } from "./dom.js";
import { clock, fixed } from "./format.js";
import { age, going, quiet, seen } from "./live.js";

const PHASES = {
  enable: "switching on the servos",
  home: "homing the axes",
  mount: "waiting for the sensor to be mounted",
  approach: "moving to the start of the step",
  work: "measuring",
  moves: "turning",
  holds: "holding",
  return: "returning to zero",
  manual: "manual control",
  paused: "paused",
  done: "all steps done",
  aborted: "stopped",
};
const LINKS = {
  connecting: "connecting …",
  live: "connected",
  silent: "no data",
  quiet: "no reply",
  lost: "disconnected",
};

export function makeHeader() {
  const header = document.querySelector("header");
  const [over, sensor, phase, time] = ["over", "sensor", "phase", "clock"].map(byId);
  const [link, lost, trouble, progress] = ["link", "lost", "trouble", "progress"].map(byId);

  // Do not scroll a focused element behind the header, whose height changes.
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
    put(over, "bench live page");
    put(sensor, "Set up a run");
    document.title = "inercal bench";
    delete document.body.dataset.bench;
    put(trouble, "");
    show();
  }

  /** Show phase and times from the latest messages. */
  function show() {
    put(phase, words());
    const state = seen.state;
    progress.hidden = !state;
    if (!state) return put(time, seen.plan ? `${clock(seen.plan.seconds)} planned` : "");
    const [gone, left] = [state.time, Math.max(state.remaining ?? 0, 0)];
    progress.value = seen.done?.state === "done" ? 1 : gone / Math.max(gone + left, 1e-9);
    mark(time, "time", String(gone));
    const fast = state.speed > 1.5 ? ` (${fixed(state.speed, 0)}×)` : "";
    if (seen.plan?.manual) put(time, `${clock(gone)} since the start`);
    else put(time, `${stepCount()}${clock(gone)} elapsed${seen.done ? "" : `, ${clock(left)} left${fast}`}`);
    put(trouble, state.trouble && !seen.done ? `▲ ${state.trouble}` : "");
  }

  function connection() {
    const { link: now } = seen;
    link.dataset.link = now;
    put(link, LINKS[now]);
    const old = ["lost", "quiet"].includes(now) || (now === "silent" && going());
    document.body.classList.toggle("old", old);
    if (now === "lost") {
      put(lost, "Connection lost. This page shows old data, and its STOP button cannot reach "
        + "the table: use the emergency stop. Reconnecting …");
    } else if (now === "quiet") {
      put(lost, `The server has sent nothing for ${fives(quiet())} s or more, so the connection may `
        + "be broken. This page shows old data, and its STOP button may not reach the table: use "
        + "the emergency stop.");
    } else if (now === "silent" && going()) {
      const seconds = fives(age()) || 2;
      put(lost, `No data from the bench for ${seconds} s or more. This page shows old data.`);
    } else put(lost, "");
  }

  return {
    hello: () => put(byId("version"), `inercal ${seen.version}`),
    plan, idle, phase: show, state: show, done: show, link: connection,
  };
}

/** Round to multiples of 5 s, because a screen reader reads each change aloud. */
const fives = (seconds) => Math.floor(seconds / 5) * 5;

function words() {
  const { state, done } = seen;
  if (done) return done.state === "manual" ? "manual control has ended" : done.state;
  if (seen.phase) return seen.phase;
  if (!state) return seen.plan ? "starting" : "";
  if (state.paused) return /^paused/.test(state.paused) ? state.paused : `paused: ${state.paused}`;
  const doing = PHASES[state.phase] ?? state.phase;
  const step = currentStep();
  return step ? `${step.label}, ${doing}` : doing;
}

/** The current step; undefined before the first, after the last and between steps. */
function currentStep() {
  const { state, plan, done } = seen;
  if (done || !state || ["enable", "home", "return", "done", "aborted"].includes(state.phase)) return undefined;
  return plan?.steps[state.done];
}

const stepCount = () => (currentStep() ? `step ${seen.state.done + 1} of ${seen.plan.steps.length} · ` : "");

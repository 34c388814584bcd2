/**
 * The main module of the page; start reading here.
 *
 * `live.js` keeps the connection and passes each message from the bench to the parts below. Each
 * part has a function for each kind of message that it shows, with the name of this kind. Parts
 * draw in `frame`, once per screen frame, and only while the page is visible.
 */

import { makeAlarms } from "./alarms.js";
import { makeAttitude } from "./attitude.js";
import { makeBench } from "./bench.js";
import { makeCharts } from "./charts.js";
import { makeControls } from "./controls.js";
import { makeCourse } from "./course.js";
import { byId, put } from "./dom.js";
import { makeEarlier } from "./earlier.js";
import { makeEstimates } from "./estimates.js";
import { makeEvents } from "./events.js";
import { makeFinished } from "./finished.js";
import { makeHeader } from "./header.js";
import { listen } from "./keys.js";
import { connect, seen } from "./live.js";
import { makeManualStart } from "./manual_start.js";
import { makeMarks } from "./marks.js";
import { makeMounting } from "./mounting.js";
import { notice } from "./notice.js";
import { makePeople } from "./people.js";
import { makeSetup } from "./setup.js";
import { makeSteps } from "./steps.js";
import { followTheme } from "./theme.js";

const broken = new Set(); // parts whose failure was reported

// Make STOP first, so that it is there even if another part cannot be made.
const people = made("people", makePeople);
const controls = made("controls", makeControls);
const theme = made("theme", followTheme);
const marks = makeMarks();
const charts = made("charts", () => makeCharts(theme, marks));
const course = made("course", () => makeCourse(theme, marks));
const setup = made("set-up", () => makeSetup(people));
const attitude = made("attitude", () => makeAttitude(theme));
const estimates = made("estimates", () => makeEstimates(course));
// A run does not need this part; it is loaded when a manual session begins.
const manual = fetched("manual panel", (plan) => plan.manual,
  async () => (await import("./manual.js")).makeManual(theme, marks));

const parts = Object.entries({
  view: { hello: showView, idle: showView, plan: showView, phase: showView, done: showView },
  header: made("header", makeHeader),
  people,
  controls,
  "set-up": setup,
  "manual panel": manual,
  "manual start": made("manual start", () => makeManualStart(people, setup)),
  "earlier runs": made("earlier runs", () => makeEarlier(people, setup)),
  charts,
  bench: made("bench", makeBench),
  attitude,
  mounting: made("mounting", makeMounting),
  steps: made("steps", makeSteps),
  estimates,
  events: made("events", () => makeEvents(marks, showTime)),
  alarms: made("alarms", makeAlarms),
  end: made("end", () => makeFinished(people)),
});

/** Measurements of the page: frames drawn by the charts, and messages received. */
const counts = { frames: 0, messages: 0 };
window.inercal = counts;

made("keys", () => listen(controls));
connect((message) => {
  if (message.kind !== "link") counts.messages += 1;
  for (const [name, part] of parts) safely(name, () => part[message.kind]?.(message));
});
requestAnimationFrame(frame);

/** Call a function of a part; a failure is reported once and does not affect other parts. */
function safely(name, what) {
  try {
    return what();
  } catch (error) {
    if (!broken.has(name)) {
      broken.add(name);
      console.error(error);
      notice(`These parts of the page do not work: ${[...broken].join(", ")} (${error.message}).`);
    }
    return null;
  }
}

/** Make a part; a part that cannot be made shows nothing. */
function made(name, make) {
  return safely(name, make) ?? {};
}

/** A part that is loaded when a plan needs it, and then receives the messages that it missed. */
function fetched(name, needs, load) {
  let part = null;
  let missed = null;
  const hear = (kind) => (message) => {
    if (kind === "plan" && !missed && needs(message)) {
      missed = [];
      load().then((loaded) => {
        part = loaded;
        for (const [of, one] of missed) safely(name, () => part[of]?.(one));
      }, (error) => safely(name, () => { throw error; }));
    }
    missed?.push([kind, message]);
  };
  const own = ["frame", "showTime"]; // functions of a part that are not messages
  return new Proxy({}, { get: (_, kind) => (part ? part[kind] : own.includes(kind) ? undefined : hear(kind)) });
}

/** Draw moving parts. The browser gives no frames to a hidden tab. */
function frame(now) {
  requestAnimationFrame(frame);
  if (!seen.plan) return;
  counts.frames += safely("charts", () => charts.frame?.(now)) ?? 0;
  safely("attitude", () => attitude.frame?.(now));
  safely("estimates", () => estimates.frame?.(now));
  safely("course", () => course.frame?.());
  safely("manual panel", () => manual.frame?.());
}

/** Show the readings at a run time in the plots. */
function showTime(time) {
  const trends = manual.showTime?.(time);
  if (!charts.showTime?.(time) && !trends) notice("This page no longer has the readings of that time: see the report.");
  course.showTime?.(time);
}

/** Show the set-up until a run begins, then the run. */
function showView() {
  const view = seen.plan || seen.done ? "run" : seen.phase ? "start" : seen.idle ? "setup" : "wait";
  byId("live").hidden = !seen.plan;
  if (view === "start") put(byId("wait"), `${seen.phase} …`);
  const before = document.body.dataset.view;
  if (before === view) return;
  document.body.dataset.view = view;
  notice("");
  scrollTo(0, 0);
  // When the title has changed: the focused element may be gone, and a screen reader would start nowhere.
  if (before !== "wait") queueMicrotask(focusTitle);
}

function focusTitle() {
  const now = document.activeElement ?? document.body;
  if (now === document.body || !now.checkVisibility()) {
    byId("sensor").focus({ preventScroll: true });
  }
}

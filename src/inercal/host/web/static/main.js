/**
 * The page, as one reads it first.
 *
 * `live.js` keeps the connection and hands each message of the bench to the parts below; each part
 * has a function for each kind of message that it shows, named after the kind. What is drawn is
 * drawn in `frame`, once for each picture of the screen, and only while somebody can see it.
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

const broken = new Set(); // the parts of which that was said

// STOP first: whatever of the rest cannot be made, it is there.
const people = made("people", makePeople);
const controls = made("controls", makeControls);
const theme = made("theme", followTheme);
const marks = makeMarks();
const charts = made("charts", () => makeCharts(theme, marks));
const course = made("course", () => makeCourse(theme, marks));
const setup = made("set-up", () => makeSetup(people));
const attitude = made("attitude", () => makeAttitude(theme));
const estimates = made("estimates", () => makeEstimates(course));
// A run does not need it: it is fetched when a manual session begins.
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

/** What is measured of the page: pictures drawn of the charts, and messages heard. */
const counts = { frames: 0, messages: 0 };
window.inercal = counts;

made("keys", () => listen(controls));
connect((message) => {
  if (message.kind !== "link") counts.messages += 1;
  for (const [name, part] of parts) safely(name, () => part[message.kind]?.(message));
});
requestAnimationFrame(frame);

/** Do something of a part; one that fails is said once, and silences no other. */
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

/** Make a part; one that cannot be made shows nothing. */
function made(name, make) {
  return safely(name, make) ?? {};
}

/** A part that is fetched once a plan needs it, and then hears what it has missed. */
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
  const own = ["frame", "showTime"]; // what is asked of a part and is no message
  return new Proxy({}, { get: (_, kind) => (part ? part[kind] : own.includes(kind) ? undefined : hear(kind)) });
}

/** Draw what moves. A tab that is hidden is given no frames. */
function frame(now) {
  requestAnimationFrame(frame);
  if (!seen.plan) return;
  counts.frames += safely("charts", () => charts.frame?.(now)) ?? 0;
  safely("attitude", () => attitude.frame?.(now));
  safely("estimates", () => estimates.frame?.(now));
  safely("course", () => course.frame?.());
  safely("manual panel", () => manual.frame?.());
}

/** Show in the plots what was read at a time of the run. */
function showTime(time) {
  const trends = manual.showTime?.(time);
  if (!charts.showTime?.(time) && !trends) notice("This page no longer has the readings of that time: see the report.");
  course.showTime?.(time);
}

/** The set-up until a run begins, then the run. */
function showView() {
  const view = seen.plan || seen.done ? "run" : seen.phase ? "start" : seen.idle ? "setup" : "wait";
  byId("live").hidden = !seen.plan;
  if (view === "start") put(byId("wait"), `${seen.phase} …`);
  const before = document.body.dataset.view;
  if (before === view) return;
  document.body.dataset.view = view;
  notice("");
  scrollTo(0, 0);
  // Once the title says what this is. What had the focus may be gone: a reader would begin at none.
  if (before !== "wait") queueMicrotask(focusTitle);
}

function focusTitle() {
  const now = document.activeElement ?? document.body;
  if (now === document.body || !now.checkVisibility()) {
    byId("sensor").focus({ preventScroll: true });
  }
}

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
import { makePeople } from "./people.js";
import { makeSetup } from "./setup.js";
import { makeSteps } from "./steps.js";
import { followTheme } from "./theme.js";

const theme = followTheme();
const people = makePeople();
const controls = makeControls();
const charts = makeCharts(theme);
const course = makeCourse(theme);
const setup = makeSetup(people);
const attitude = makeAttitude(theme);
const estimates = makeEstimates(theme, course);

const parts = [
  { hello: showView, idle: showView, plan: showView, phase: showView, done: showView },
  makeHeader(),
  people,
  controls,
  setup,
  makeEarlier(people, setup),
  charts,
  makeBench(),
  attitude,
  makeSteps(),
  estimates,
  makeEvents(),
  makeAlarms(),
  makeFinished(people),
];

/** What is measured of the page: pictures drawn of the charts, and messages heard. */
const counts = { frames: 0, messages: 0 };
window.inercal = counts;

listen(controls);
connect((message) => {
  if (message.kind !== "link") counts.messages += 1;
  for (const part of parts) part[message.kind]?.(message);
});
requestAnimationFrame(frame);

/** Draw what moves. A tab that is hidden is given no frames. */
function frame(now) {
  requestAnimationFrame(frame);
  if (!seen.plan) return;
  counts.frames += charts.frame(now);
  attitude.frame(now);
  estimates.frame(now);
}

/** The set-up until a run begins, then the run. */
function showView() {
  const view = seen.plan || seen.done ? "run" : seen.phase ? "start" : seen.idle ? "setup" : "wait";
  byId("live").hidden = !seen.plan;
  if (view === "start") put(byId("wait"), `${seen.phase} …`);
  if (document.body.dataset.view === view) return;
  document.body.dataset.view = view;
  scrollTo(0, 0);
}

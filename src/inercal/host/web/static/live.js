/**
 * The socket to the bench, and what was heard last.
 *
 * Every part of the page reads `seen`; only this file writes it. A lost connection is looked for
 * again by itself, and what is shown meanwhile is marked as old. No command waits for a connection:
 * what was meant for a table a minute ago may be wrong now.
 *
 * The server sends a beat every 2 s, also when nothing goes on: a connection that broke without a
 * word is known by its silence alone.
 */

import { ofTab } from "./store.js";

const TAB = "inercal.tab"; // by which the server knows that it is this page that connects again
const WAITS = [0.5, 1, 2, 3]; // s until the next attempt
const SILENT = 2.5; // s without a word of a run that goes on: what is shown is old
const QUIET = 5; // s without a word of any kind: the connection may be broken
const DEAD = 9; // s: it is given up; an operator's place is kept for 10 s
const HANGS = 4; // s that an attempt may take
const STARTS = new Set(["start", "resume", "go on", "mounted", "begin manual", "manual"]); // what sets a table in motion

/** What the bench has said last. */
export const seen = {
  link: "connecting", // "live", "silent" (no news of the run), "quiet" (no word) or "lost"
  since: 0, // ms of performance.now(): when there was news of the run
  version: "",
  people: { viewers: 0, operator: null, yours: false },
  idle: false,
  plan: null,
  phase: "",
  state: null,
  done: null,
};

let socket = null;
let opened = 0; // ms: when the attempt began
let word = 0; // ms: when anything was heard, or the attempt began
let newest = NaN; // s of the run: what is told again to who connects again is no news
let attempts = 0;
let tell = () => {};

/** Connect, and hand each message to `hear`; a change of the link is one of kind "link". */
export function connect(hear) {
  tell = hear;
  attempt();
  setInterval(watch, 500);
  addEventListener("online", () => {
    if (socket?.readyState === WebSocket.OPEN) return;
    giveUp();
    attempt();
  });
}

/**
 * Send a command; false when there is no connection, and it is not kept. One that starts something
 * is not sent either where what is shown is old: who wants it does not see what it starts from.
 */
export function say(command) {
  if (socket?.readyState !== WebSocket.OPEN) return false;
  if (STARTS.has(command.do) && seen.link !== "live") return false;
  socket.send(JSON.stringify(command));
  return true;
}

/** Whether a run is going on, as far as is known. */
export const going = () => seen.done === null && (seen.plan !== null || seen.phase !== "");

/** Seconds since there was news of the run. */
export const age = () => (performance.now() - seen.since) / 1000;

/** Seconds since there was a word of any kind. */
export const quiet = () => (performance.now() - word) / 1000;

/** Whether there was a word since then, ms. */
export const heardSince = (then) => word > then;

/** Whether states should come, ten a second. */
const expected = () => going() && seen.state !== null && !seen.phase;

function attempt() {
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  const made = new WebSocket(`${scheme}//${location.host}/live?tab=${tab()}`);
  socket = made;
  opened = word = performance.now();
  made.onmessage = (event) => socket === made && heard(event.data);
  made.onclose = () => {
    if (socket !== made) return;
    socket = null;
    setTimeout(() => socket ?? attempt(), 1000 * WAITS[Math.min(attempts, WAITS.length - 1)]);
    failed();
  };
}

function tab() {
  if (!ofTab.get(TAB)) {
    const bytes = crypto.getRandomValues(new Uint8Array(16));
    ofTab.set(TAB, Array.from(bytes, (one) => one.toString(16).padStart(2, "0")).join(""));
  }
  return ofTab.get(TAB);
}

/** Drop the connection or the attempt, which says nothing of its end any more. */
function giveUp() {
  const given = socket;
  socket = null;
  given?.close();
}

function failed() {
  change("lost");
  attempts += 1;
  if (attempts % 3 === 0) askForToken();
}

/** The page that asks for a token comes up where the one of before is no longer taken. */
async function askForToken() {
  const answer = await fetch("/api/setup").catch(() => null);
  if (answer?.status === 401) location.reload();
}

function heard(text) {
  let message;
  try {
    message = JSON.parse(text);
  } catch {
    return;
  }
  attempts = 0;
  word = performance.now();
  // The server sends more once it knows that this has come.
  if (message.kind === "mark") return socket?.send(JSON.stringify({ do: "seen", n: message.n }));
  keep(message);
  tell(message);
  change(expected() && age() > SILENT ? "silent" : "live");
}

function keep(message) {
  switch (message.kind) {
    case "hello":
      seen.version = message.version;
      break;
    case "people":
      seen.people = message;
      break;
    case "idle":
      Object.assign(seen, { idle: true, plan: null, phase: "", state: null, done: null });
      break;
    case "plan":
      Object.assign(seen, { idle: false, plan: message, phase: "", state: null, done: null });
      break;
    case "phase":
      // After its end a run that is resumed, or another one, begins.
      if (seen.done) Object.assign(seen, { plan: null, state: null, done: null });
      seen.idle = false;
      seen.phase = message.words;
      break;
    case "state":
      if (message.time !== newest) seen.since = performance.now();
      newest = message.time;
      seen.state = message;
      seen.phase = "";
      break;
    case "done":
      seen.done = message;
      seen.phase = "";
      break;
  }
}

function change(link) {
  if (seen.link === link) return;
  seen.link = link;
  tell({ kind: "link", link });
}

/** A socket may be open with nobody at its other end, and an attempt may never come to an end. */
function watch() {
  if (!socket) return;
  if (socket.readyState === WebSocket.CONNECTING) {
    if (performance.now() - opened > 1000 * HANGS) again();
  } else if (quiet() > DEAD) again();
  else if (seen.link === "lost") return; // it is open, but nothing has come by it
  else if (quiet() > QUIET) mark("quiet");
  else if (expected() && age() > SILENT) mark("silent");
}

function again() {
  giveUp();
  failed();
  attempt();
}

/** Say it each time: for how long is said too. */
function mark(link) {
  seen.link = link;
  tell({ kind: "link", link });
}

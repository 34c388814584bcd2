/**
 * The socket to the bench, and the latest messages.
 *
 * Every part of the page reads `seen`, and only this file writes it. A lost connection is restored
 * automatically, and what is shown meanwhile is marked as old. Commands are never queued, because
 * what was meant for a table a minute ago may be wrong now.
 *
 * The server sends a heartbeat every 2 s, even if nothing happens. Only its absence shows that a
 * connection has broken without notice.
 */

import { ofTab } from "./store.js";

const TAB = "inercal.tab"; // key by which the server recognises this page when it reconnects
const WAITS = [0.5, 1, 2, 3]; // s until the next attempt
const SILENT = 2.5; // s without news of an active run, after which the shown state is old
const QUIET = 5; // s without any message, after which the connection may be broken
const DEAD = 9; // s after which the connection is given up; an operator's place is kept for 10 s
const HANGS = 4; // s that an attempt may take
const STARTS = new Set(["start", "resume", "go on", "mounted", "begin manual", "manual"]); // commands that move a table

/** The latest messages from the bench. */
export const seen = {
  link: "connecting", // "live", "silent" (no news of the run), "quiet" (no messages) or "lost"
  since: 0, // ms of performance.now() at the last news of the run
  version: "",
  people: { viewers: 0, operator: null, yours: false },
  idle: false,
  plan: null,
  phase: "",
  state: null,
  done: null,
};

let socket = null;
let opened = 0; // ms: beginning of the connection attempt
let word = 0; // ms: time of the last message, or beginning of the attempt
let newest = NaN; // s of the run; messages that are repeated after reconnecting are not news
let attempts = 0;
let tell = () => {};

/** Connect, and pass each message to `hear`; a change of the link is a message of kind "link". */
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
 * Send a command; return false without a connection, as commands are not queued. A command that
 * starts something is also not sent while the shown state is old, because the user does not see
 * from which state it would start.
 */
export function say(command) {
  if (socket?.readyState !== WebSocket.OPEN) return false;
  if (STARTS.has(command.do) && seen.link !== "live") return false;
  socket.send(JSON.stringify(command));
  return true;
}

/** Whether a run is active, if known. */
export const going = () => seen.done === null && (seen.plan !== null || seen.phase !== "");

/** Seconds since the last news of the run. */
export const age = () => (performance.now() - seen.since) / 1000;

/** Seconds since the last message of any kind. */
export const quiet = () => (performance.now() - word) / 1000;

/** Whether there was a message since a time, ms. */
export const heardSince = (then) => word > then;

/** Whether states are expected, ten per second. */
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

/** Drop the connection or the attempt, and ignore its closing event. */
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

/** Show the page that asks for a token if the earlier token is no longer accepted. */
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
  // The server sends more when it knows that this has arrived.
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
      // After the end, a resumed run or another run begins.
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

/** A socket may stay open without another end, and a connection attempt may never end. */
function watch() {
  if (!socket) return;
  if (socket.readyState === WebSocket.CONNECTING) {
    if (performance.now() - opened > 1000 * HANGS) again();
  } else if (quiet() > DEAD) again();
  else if (seen.link === "lost") return; // the socket is open, but nothing has arrived yet
  else if (quiet() > QUIET) mark("quiet");
  else if (expected() && age() > SILENT) mark("silent");
}

function again() {
  giveUp();
  failed();
  attempt();
}

/** Report this each time, because the duration is also shown. */
function mark(link) {
  seen.link = link;
  tell({ kind: "link", link });
}

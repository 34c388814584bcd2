/**
 * The socket to the bench, and what was heard last.
 *
 * Every part of the page reads `seen`; only this file writes it. A lost connection is looked for
 * again by itself, and what is shown meanwhile is marked as old. No command waits for a connection:
 * what was meant for a table a minute ago may be wrong now.
 */

const WAITS = [0.5, 1, 2, 3]; // s until the next attempt
const SILENT = 2.5; // s without a word of a run that goes on: what is shown is old
const DEAD = 12; // s: the connection is given up

/** What the bench has said last. */
export const seen = {
  link: "connecting", // "live", "silent" or "lost"
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
let opened = 0; // ms
let newest = NaN; // s of the run: what is told again to who connects again is no news
let attempts = 0;
let tell = () => {};

/** Connect, and hand each message to `hear`; a change of the link is one of kind "link". */
export function connect(hear) {
  tell = hear;
  attempt();
  setInterval(watch, 500);
  addEventListener("online", () => socket ?? attempt());
}

/** Send a command; false when there is no connection, and it is not kept. */
export function say(command) {
  if (socket?.readyState !== WebSocket.OPEN) return false;
  socket.send(JSON.stringify(command));
  return true;
}

/** Whether a run is going on, as far as is known. */
export const going = () => seen.done === null && (seen.plan !== null || seen.phase !== "");

/** Seconds since there was news of the run. */
export const age = () => (performance.now() - seen.since) / 1000;

/** Whether states should come, ten a second. */
const expected = () => going() && seen.state !== null && !seen.phase;

function attempt() {
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  const made = new WebSocket(`${scheme}//${location.host}/live`);
  socket = made;
  opened = performance.now();
  made.onmessage = (event) => socket === made && heard(event.data);
  made.onclose = () => {
    if (socket !== made) return;
    socket = null;
    change("lost");
    setTimeout(() => socket ?? attempt(), 1000 * WAITS[Math.min(attempts, WAITS.length - 1)]);
    attempts += 1;
    if (attempts % 3 === 0) askForToken();
  };
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

/** A socket may be open with nobody at its other end. */
function watch() {
  if (seen.link === "lost" || seen.link === "connecting") return;
  if (!expected()) return;
  if (Math.min(age(), (performance.now() - opened) / 1000) > DEAD) {
    const given = socket;
    socket = null;
    given?.close();
    change("lost");
    attempt();
  } else if (age() > SILENT) {
    seen.link = "silent";
    tell({ kind: "link", link: "silent" });
  }
}

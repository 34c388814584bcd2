/** The events of a run by time, as every plot marks them. */

export function makeMarks() {
  let events = []; // by number
  const marks = { changed: [], add, between, clear, get all() { return events; } };

  /** Add events, except known ones; return the position of each new one. */
  function add(some) {
    const fresh = [];
    for (const event of some) {
      let at = events.length;
      while (at && events[at - 1].n > event.n) at -= 1;
      if (at && event.n != null && events[at - 1].n === event.n) continue;
      events.splice(at, 0, event);
      fresh.push([event, events[at + 1] ?? null]);
    }
    if (fresh.length) for (const tell of marks.changed) tell();
    return fresh;
  }

  function between(from, to) {
    return events.filter(({ time }) => Number.isFinite(time) && time >= from && time <= to);
  }

  function clear() {
    events = [];
    for (const tell of marks.changed) tell();
  }

  return marks;
}

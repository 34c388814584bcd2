/**
 * The latest samples of all channels, contiguous in memory, so that a chart can use them directly.
 * At the end of the memory, the samples still needed move to the front; nothing is reallocated.
 */

const SIZE = 1 << 15;
const KEPT = 1 << 13; // 33 s at 250 samples per second, the highest rate that the bench sends

export class Ring {
  constructor(channels) {
    this.time = new Float64Array(SIZE);
    this.values = Array.from({ length: channels }, () => new Float64Array(SIZE));
    this.end = 0;
  }

  /** Add later samples: times (n), and n values of each channel. */
  append(t, y) {
    const before = this.end ? this.time[this.end - 1] : -Infinity;
    // A viewer whose link becomes faster may get samples that earlier means include.
    const known = t.findIndex((one) => one > before);
    if (known < 0 || t.length > SIZE - KEPT) return;
    if (known > 0) [t, y] = [t.slice(known), y.map((channel) => channel?.slice(known))];
    if (this.end + t.length > SIZE) this.#moveToFront();
    this.time.set(t, this.end);
    // Unknown values are stored as 0/0, through which no line is drawn.
    this.values.forEach((channel, i) => {
      const from = y[i];
      for (let k = 0; k < t.length; k++) channel[this.end + k] = from?.[k] ?? NaN;
    });
    this.end += t.length;
  }

  /** Add earlier samples, except those that are known already. */
  prepend(t, y) {
    const first = this.end ? this.time[0] : Infinity;
    const n = t.filter((one) => one < first).length;
    if (!n || this.end + n > SIZE) return;
    for (const [row, from] of [[this.time, t], ...this.values.map((row, i) => [row, y[i]])]) {
      row.copyWithin(n, 0, this.end);
      for (let k = 0; k < n; k++) row[k] = from[k] ?? NaN;
    }
    this.end += n;
  }

  /** The index of the first sample at or after a time. */
  from(time) {
    let [low, high] = [0, this.end];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time[middle] < time) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  #moveToFront() {
    const begin = Math.max(0, this.end - KEPT);
    this.time.copyWithin(0, begin, this.end);
    for (const channel of this.values) channel.copyWithin(0, begin, this.end);
    this.end -= begin;
  }
}

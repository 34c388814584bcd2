/** The history of the estimates: value and 2σ of each coefficient, at intervals. */

const MOST = 1200;

export class History {
  constructor(coefficients) {
    this.count = coefficients;
    this.size = 0;
    this.time = new Float64Array(MOST);
    this.value = Array.from({ length: coefficients }, () => new Float64Array(MOST));
    this.spread = Array.from({ length: coefficients }, () => new Float64Array(MOST));
  }

  /**
   * Store the estimates at a time; null means not known yet. A viewer who connects late gets the
   * latest first, then earlier ones in increasing detail. Return whether this is the latest.
   */
  add(time, values, spreads) {
    if (this.size === MOST) this.#thin();
    let at = this.size;
    while (at && this.time[at - 1] >= time) at -= 1;
    if (at < this.size && this.time[at] === time) return at === this.size - 1;
    for (const row of [this.time, ...this.value, ...this.spread]) row.copyWithin(at + 1, at, this.size);
    this.time[at] = time;
    for (let i = 0; i < this.count; i++) {
      this.value[i][at] = values[i] ?? NaN;
      this.spread[i][at] = spreads[i] ?? NaN;
    }
    this.size += 1;
    return at === this.size - 1;
  }

  /** Thin out the history, so that the last hours of a long run cost no more than the first minutes. */
  #thin() {
    for (const row of [this.time, ...this.value, ...this.spread]) {
      for (let k = 0; k < MOST / 2; k++) row[k] = row[2 * k + 1];
    }
    this.size = MOST / 2;
  }
}

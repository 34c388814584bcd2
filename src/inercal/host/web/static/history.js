/** The estimates over time: of each coefficient value and 2σ, every so often. */

const MOST = 1200;

export class History {
  constructor(coefficients) {
    this.count = coefficients;
    this.size = 0;
    this.time = new Float64Array(MOST);
    this.value = Array.from({ length: coefficients }, () => new Float64Array(MOST));
    this.spread = Array.from({ length: coefficients }, () => new Float64Array(MOST));
  }

  /** Take in what was found at a time; nulls are not known yet. */
  append(time, values, spreads) {
    if (this.size && time <= this.time[this.size - 1]) this.size = 0; // of a run that was resumed
    if (this.size === MOST) this.#thin();
    this.time[this.size] = time;
    for (let i = 0; i < this.count; i++) {
      this.value[i][this.size] = values[i] ?? NaN;
      this.spread[i][this.size] = spreads[i] ?? NaN;
    }
    this.size += 1;
  }

  /** Keep every second: the last hours of a long run cost no more than its first minutes. */
  #thin() {
    for (const row of [this.time, ...this.value, ...this.spread]) {
      for (let k = 0; k < MOST / 2; k++) row[k] = row[2 * k + 1];
    }
    this.size = MOST / 2;
  }
}

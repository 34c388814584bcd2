/**
 * The position of the charts' right edge in the stream.
 *
 * Samples arrive in pieces of about half a second. The edge moves at the speed of the stream, far
 * enough behind its end that the next piece arrives before the edge gets there. So the picture
 * moves smoothly.
 */

const KEPT = 8; // pieces; the one with the largest step is ignored, because it may be a jump
const BEHIND = 1.5; // pieces
const LEAST = 0.8; // s of wall time; several small pieces are drawn together
const AT_ONCE = 0.02; // s; pieces that arrive closer together count as one

export class Playhead {
  constructor() {
    this.clear();
  }

  clear() {
    this.at = NaN; // recording time, s
    this.pace = 1; // recording time per wall time
    this.newest = NaN;
    this.piece = 0.5; // recording time, s
    this.pieces = []; // [recording time, wall time], s
    this.came = 0;
    this.moved = 0;
    this.hurry = 0;
  }

  /** Add a piece whose last sample is at `newest`; `now` is in ms. */
  hear(newest, now) {
    const waited = (now - this.came) / 1000;
    const step = newest - this.newest;
    if (!(step > 0) || waited > 5) {
      this.clear();
      Object.assign(this, { newest, came: now, moved: now });
      this.at = newest - this.#behind();
      return;
    }
    this.newest = newest;
    if (waited < AT_ONCE) return;
    this.came = now;
    this.pieces.push([step, waited]);
    if (this.pieces.length > KEPT) this.pieces.shift();
    this.#measure();
    const behind = this.#behind();
    const error = newest - behind - this.at;
    if (Math.abs(error) > 2.5 * behind) this.at += error;
    // Make up for the difference during the next pieces, in steps that are too small to see.
    else this.hurry = Math.max(-0.3, Math.min(0.3, error / (2.5 * behind)));
  }

  /** Advance to `now`, ms; false if the edge does not move. */
  move(now) {
    const passed = Math.max(0, Math.min((now - this.moved) / 1000, 0.25));
    this.moved = now;
    const before = this.at;
    this.at = Math.min(this.newest, this.at + this.pace * (1 + this.hurry) * passed);
    return this.at !== before;
  }

  #behind() {
    return Math.max(BEHIND * this.piece, LEAST * this.pace);
  }

  #measure() {
    const most = Math.max(...this.pieces.map(([step]) => step));
    const usual = this.pieces.filter(([step]) => this.pieces.length < 3 || step < most);
    const counted = usual.length ? usual : this.pieces;
    const sum = (k) => counted.reduce((all, one) => all + one[k], 0);
    this.piece = sum(0) / counted.length;
    this.pace = sum(0) / sum(1);
  }
}

/**
 * Where in the stream the charts' right edge is.
 *
 * Samples come in pieces of about half a second. The edge moves at the pace of the stream, so far
 * behind its end that the next piece comes before the edge is there: a picture that glides.
 */

const KEPT = 8; // pieces, of which that with the largest step is left out: it may be a jump
const BEHIND = 1.5; // pieces
const LEAST = 0.8; // s of the wall: small pieces are drawn several at a time
const AT_ONCE = 0.02; // s: pieces that come together count as one

export class Playhead {
  constructor() {
    this.clear();
  }

  clear() {
    this.at = NaN; // s of the recording
    this.pace = 1; // s of the recording in one of the wall's
    this.newest = NaN;
    this.piece = 0.5; // s of the recording
    this.pieces = []; // [s of the recording, s of the wall]
    this.came = 0;
    this.moved = 0;
    this.hurry = 0;
  }

  /** A piece came whose last sample is at `newest`; `now` in ms. */
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
    // What is missing is made up for during the next pieces, by less than eyes see.
    else this.hurry = Math.max(-0.3, Math.min(0.3, error / (2.5 * behind)));
  }

  /** Move on to `now`, ms; false when the edge stays where it is. */
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

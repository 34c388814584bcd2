/**
 * Where in the stream the charts' right edge is.
 *
 * Samples come in pieces of about half a second. The edge moves at the pace of the stream, so far
 * behind its end that the next piece comes before the edge is there: a picture that glides.
 */

const SHARE = 0.2; // of a new piece in the running means
const BEHIND = 1.5; // pieces
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
    this.every = 0.5; // s of the wall
    this.came = 0;
    this.moved = 0;
    this.hurry = 0;
  }

  /** A piece came whose last sample is at `newest`; `now` in ms. */
  hear(newest, now) {
    const waited = (now - this.came) / 1000;
    const step = newest - this.newest;
    if (!(step > 0) || waited > 5) {
      const { pace, piece, every } = this;
      this.clear();
      if (step > 0) Object.assign(this, { pace, piece, every });
      Object.assign(this, { newest, came: now, moved: now });
      this.at = newest - BEHIND * this.piece;
      return;
    }
    this.newest = newest;
    if (waited < AT_ONCE) return;
    this.came = now;
    this.piece += SHARE * (step - this.piece);
    this.every += SHARE * (waited - this.every);
    this.pace = this.piece / this.every;
    const error = newest - BEHIND * this.piece - this.at;
    if (Math.abs(error) > 4 * this.piece) this.at += error;
    // What is missing is made up for during the next pieces, by less than eyes see.
    else this.hurry = Math.max(-0.3, Math.min(0.3, error / (4 * this.piece)));
  }

  /** Move on to `now`, ms; false when the edge stays where it is. */
  move(now) {
    const passed = Math.max(0, Math.min((now - this.moved) / 1000, 0.25));
    this.moved = now;
    const before = this.at;
    this.at = Math.min(this.newest, this.at + this.pace * (1 + this.hurry) * passed);
    return this.at !== before;
  }

  /** The seconds that ten of the wall's take, as a round number. */
  get window() {
    if (this.pace < 1.5) return 10;
    const power = 10 ** Math.floor(Math.log10(this.pace));
    const lead = this.pace / power;
    return 10 * power * (lead < 1.5 ? 1 : lead < 3.5 ? 2 : lead < 7.5 ? 5 : 10);
  }
}

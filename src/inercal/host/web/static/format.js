/** Numbers as text. An unknown number is shown as a dash. */

const NOTHING = "—";

/** Use real minus signs, because a hyphen is too short next to digits. */
export const minus = (text) => text.replaceAll("-", "\u2212");

/** A number with a given number of decimals. */
export function fixed(x, places) {
  return Number.isFinite(x) ? minus((+x.toFixed(places) + 0).toFixed(places)) : NOTHING;
}

/** The same with its sign. */
export function signed(x, places) {
  if (!Number.isFinite(x)) return NOTHING;
  const text = fixed(x, places);
  return text.startsWith("\u2212") ? text : `+${text}`;
}

/** Value and uncertainty, rounded to two significant digits of the uncertainty, as in all reports. */
export function digits(value, uncertainty) {
  if (!Number.isFinite(value)) return [NOTHING, NOTHING];
  if (!(Number.isFinite(uncertainty) && uncertainty > 0)) {
    return [minus(String(+value.toPrecision(7))), NOTHING];
  }
  const places = 1 - Number(uncertainty.toExponential(1).split("e")[1]);
  return [rounded(value, places), rounded(uncertainty, places)];
}

function rounded(x, places) {
  if (places >= 0) return fixed(x, Math.min(places, 20));
  const unit = 10 ** -places;
  return fixed(Math.round(x / unit) * unit, 0);
}

/** Seconds as minutes and seconds, and with hours from one hour on. */
export function clock(seconds) {
  if (!Number.isFinite(seconds)) return NOTHING;
  const whole = Math.max(0, Math.floor(seconds));
  const two = (n) => String(n).padStart(2, "0");
  const minutes = Math.floor(whole / 60);
  if (minutes < 60) return `${minutes}:${two(whole % 60)}`;
  return `${Math.floor(minutes / 60)}:${two(minutes % 60)}:${two(whole % 60)}`;
}

/** The run time as `clock`, with as many decimals as a plot of the given length needs. */
export function instant(seconds, span) {
  const places = span < 0.1 ? 3 : span < 1 ? 2 : span < 4 ? 1 : 0;
  if (!places || !Number.isFinite(seconds)) return clock(Math.round(seconds));
  const one = 10 ** places;
  const units = Math.max(0, Math.round(seconds * one));
  return `${clock(Math.floor(units / one))}.${String(units % one).padStart(places, "0")}`;
}

/** The duration of a step or a plan. */
export function lasting(seconds) {
  if (!Number.isFinite(seconds)) return NOTHING;
  if (seconds >= 120) return `${fixed(seconds / 60, 0)} min`;
  return `${fixed(seconds, seconds < 10 ? 1 : 0)} s`;
}

/** A date and time, by this device's clock. */
export function moment(iso) {
  const at = new Date(iso);
  if (Number.isNaN(at.getTime())) return String(iso ?? "");
  const two = (n) => String(n).padStart(2, "0");
  const day = `${at.getFullYear()}-${two(at.getMonth() + 1)}-${two(at.getDate())}`;
  return `${day} ${two(at.getHours())}:${two(at.getMinutes())}`;
}

/** Colours of drawings: those of the style sheet, light or dark, as the device prefers. */

const NAMES = ["ink", "muted", "faint", "band", "paper", "accent", "side", "x", "y", "z", "care", "bad"];

/** Return the colours; when the preference changes, they are updated and `changed` is called. */
export function followTheme() {
  const theme = { changed: [] };
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const read = () => {
    const style = getComputedStyle(document.documentElement);
    for (const name of NAMES) theme[name] = style.getPropertyValue(`--${name}`).trim();
    for (const draw of theme.changed) draw();
  };
  dark.addEventListener("change", read);
  read();
  return theme;
}

/** Whether motion should be reduced. */
export const calm = matchMedia("(prefers-reduced-motion: reduce)");

/** Axes can also be distinguished without colour, by dashes and dots; in shares of the visible range. */
export const DASHES = [
  { legend: "none", period: 1, drawn: 1 },
  { legend: "7 4", period: 0.02, drawn: 0.65 },
  { legend: "2 3", period: 0.008, drawn: 0.4 },
];

/** Colours of what is drawn: those of the style sheet, light or dark, as the device asks for. */

const NAMES = ["ink", "muted", "faint", "band", "paper", "accent", "side", "x", "y", "z", "care", "bad"];

/** Return the colours; they change in place, and `changed` is called, when it turns dark. */
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

/** Whether what moves should rather jump. */
export const calm = matchMedia("(prefers-reduced-motion: reduce)");

/** Axes are told apart without colour too: a line, dashes, dots; as shares of what is in sight. */
export const DASHES = [
  { legend: "none", period: 1, drawn: 1 },
  { legend: "7 4", period: 0.02, drawn: 0.65 },
  { legend: "2 3", period: 0.008, drawn: 0.4 },
];

/**
 * A shaded box with its axes over a compass card, seen from the south and above.
 *
 * Matrices are stored by rows and transform from the body frame to the level frame (east, north,
 * up). There is no perspective; the viewer looks in a direction at an angle A from north, and down at
 * an angle E::
 *
 *     right = (cos A, sin A, 0) · p      up = (−sin A sin E, cos A sin E, cos E) · p
 *     near  = (sin A cos E, −cos A cos E, sin E) · p
 */

const [A, E] = [-0.42, 0.5]; // rad
const RIGHT = [Math.cos(A), Math.sin(A), 0];
const UP = [-Math.sin(A) * Math.sin(E), Math.cos(A) * Math.sin(E), Math.cos(E)];
const NEAR = [Math.sin(A) * Math.cos(E), -Math.cos(A) * Math.cos(E), Math.sin(E)];
const LIGHT = [-0.35, -0.45, 0.82]; // from the left, the south and above
const HALF = [0.46, 0.68, 0.28]; // half the size of the box along x, y, z; its longest side points ahead
const REACH = 1.15; // length of an axis
const FLOOR = -0.95; // height of the compass card, below the box
const CARD = 1.15;
const [WIDE, HIGH, MIDDLE] = [3.05, 3.2, 0.48]; // visible width and height, and distance of the body from the top
const LETTERS = ["x", "y", "z"];

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** Draw a body with an attitude (nine numbers); `null` draws only the card. */
export function draw(canvas, c, theme) {
  const ratio = devicePixelRatio;
  const { clientWidth: width, clientHeight: height } = canvas;
  if (!width || !height) return;
  if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
  if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
  const pen = canvas.getContext("2d");
  const scale = Math.min(width / WIDE, height / HIGH) * ratio;
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.clearRect(0, 0, canvas.width, canvas.height);
  const view = [scale, 0, 0, -scale, canvas.width / 2, canvas.height * MIDDLE];
  pen.setTransform(...view);
  pen.lineJoin = "round";
  card(pen, view, theme);
  if (!c) return;
  const axes = [0, 1, 2].map((k) => [c[k], c[3 + k], c[6 + k]]); // axes of the body in the level frame
  const order = [0, 1, 2].sort((i, k) => dot(NEAR, axes[i]) - dot(NEAR, axes[k]));
  for (const k of order) if (dot(NEAR, axes[k]) < 0) axis(pen, view, k, axes[k], theme);
  faces(pen, axes, theme);
  for (const k of order) if (dot(NEAR, axes[k]) >= 0) axis(pen, view, k, axes[k], theme);
}

const place = (p) => [dot(RIGHT, p), dot(UP, p)];

function polygon(pen, points) {
  pen.beginPath();
  for (const p of points) pen.lineTo(...place(p));
  pen.closePath();
}

/** Letters are drawn in pixels, because scaled-up type of a fifth of a pixel is not readable. */
function write(pen, view, text, p, colour, size) {
  const [x, y] = place(p);
  const [scale, , , , left, top] = view;
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.font = `600 ${Math.round(size * scale)}px system-ui`;
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.fillStyle = colour;
  pen.fillText(text, left + scale * x, top - scale * y);
  pen.setTransform(...view);
}

/** The level plane, and the direction of north. */
function card(pen, view, theme) {
  const at = (angle, r) => [r * Math.sin(angle), r * Math.cos(angle), FLOOR];
  polygon(pen, Array.from({ length: 48 }, (_, i) => at((i * Math.PI) / 24, CARD)));
  pen.fillStyle = theme.band;
  pen.fill();
  pen.lineWidth = 0.012;
  pen.strokeStyle = theme.faint;
  pen.stroke();
  for (let i = 0; i < 36; i++) {
    pen.beginPath();
    pen.moveTo(...place(at((i * Math.PI) / 18, CARD)));
    pen.lineTo(...place(at((i * Math.PI) / 18, CARD - (i % 9 ? 0.06 : 0.14))));
    pen.stroke();
  }
  polygon(pen, [at(0, 0.92), at(Math.PI / 2, 0.09), at(-Math.PI / 2, 0.09)]);
  pen.fillStyle = theme.faint;
  pen.fill();
  ["N", "E", "S", "W"].forEach((letter, i) => {
    const colour = i ? theme.muted : theme.ink;
    write(pen, view, letter, at((i * Math.PI) / 2, CARD + 0.14), colour, 0.19);
  });
}

function faces(pen, axes, theme) {
  for (let k = 0; k < 3; k++) {
    const side = dot(NEAR, axes[k]) >= 0 ? 1 : -1; // the opposite side is not visible
    const [i, j] = [(k + 1) % 3, (k + 2) % 3];
    const corner = (a, b) => [0, 1, 2].map((n) => side * HALF[k] * axes[k][n]
      + a * HALF[i] * axes[i][n] + b * HALF[j] * axes[j][n]);
    const corners = [corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)];
    polygon(pen, corners);
    pen.fillStyle = theme.side;
    pen.fill();
    pen.globalAlpha = 0.55 * (1 - (1 + side * dot(LIGHT, axes[k])) / 2);
    pen.fillStyle = "#000";
    pen.fill();
    pen.globalAlpha = 1;
    pen.lineWidth = 0.016;
    pen.strokeStyle = theme.paper;
    pen.stroke();
    if (k === 1 && side > 0) {
      // The side that points ahead has a mark.
      polygon(pen, [corner(-0.35, 0), corner(0.35, -0.45), corner(0.35, 0.45)]);
      pen.fillStyle = theme.paper;
      pen.globalAlpha = 0.6;
      pen.fill();
      pen.globalAlpha = 1;
    }
  }
}

function axis(pen, view, k, along, theme) {
  const from = along.map((x) => x * HALF[k]);
  const to = along.map((x) => x * REACH);
  const colour = theme[LETTERS[k]];
  pen.lineWidth = 0.045;
  pen.strokeStyle = colour;
  pen.beginPath();
  pen.moveTo(...place(from));
  pen.lineTo(...place(to));
  pen.stroke();
  const [x, y] = place(to);
  const [dx, dy] = place(along);
  const length = Math.hypot(dx, dy);
  if (length > 0.15) {
    const [ux, uy] = [dx / length, dy / length];
    pen.beginPath();
    pen.moveTo(x + 0.1 * ux, y + 0.1 * uy);
    pen.lineTo(x - 0.06 * uy, y + 0.06 * ux);
    pen.lineTo(x + 0.06 * uy, y - 0.06 * ux);
    pen.closePath();
    pen.fillStyle = colour;
    pen.fill();
  }
  write(pen, view, LETTERS[k], along.map((v) => v * (REACH + 0.2)), colour, 0.24);
}

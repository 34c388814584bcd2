"""Draw a figure of the measured attitudes on a sphere of body directions, seen from two sides."""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence
from math import cos, degrees, pi, sin

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from inercal.basics.arrays import Array
from inercal.benches.report_data import MeasuredDirection
from inercal.physics.plan import Hold, Rotation, Turn, describe_direction
from inercal.report import drawing
from inercal.report.drawing import BAND, FAINT, INK, MUTED, PAPER, WARN, Z, svg

FACES = tuple(tuple(sign * row) for row in np.eye(3) for sign in (1.0, -1.0))
_COVERED_COSINE = cos(25 * pi / 180)  # degrees; a hold within this angle of a face covers the face
_NOMINAL_COSINE = cos(
    10 * pi / 180
)  # a nominal attitude farther than this from every face is not a face position
_MAX_NAMED = 14  # largest number of attitudes whose names do not overlap
_RING_RADIUS = 17 * pi / 180  # angular radius of the arrow that represents a turn
_VIEW = np.array([1.0, 0.78, 0.66]) / np.linalg.norm([1.0, 0.78, 0.66])


def missing_faces(found: Sequence[MeasuredDirection]) -> list[str]:
    """Return the faces that never pointed up, such as "−z"; empty if attitudes were arbitrary."""
    holds = [(a, a.step) for a in found if isinstance(a.step, Hold)]
    if not holds or any(max(map(abs, step.up)) < _NOMINAL_COSINE for _, step in holds):
        return []
    return [
        describe_direction((float(x), float(y), float(z)))
        for x, y, z in FACES
        if not any(a.unit_vector @ np.array([x, y, z]) > _COVERED_COSINE for a, _ in holds)
    ]


@drawing.style
def sphere(found: Sequence[MeasuredDirection], side: int) -> Markup:
    """Return the sphere of body directions, seen from +x +y +z (side 1) or opposite (side −1)."""
    figure = Figure(figsize=(4.2, 4.4))
    axes = figure.add_axes((0, 0, 1, 4.2 / 4.4))
    view = side * _VIEW
    right = np.cross([0.0, 0.0, 1.0], view)
    right /= np.linalg.norm(right)
    screen = np.stack([right, np.cross(view, right), view])
    _draw_globe(axes, screen)
    missing = missing_faces(found)
    for face in FACES:
        x, y, depth = screen @ np.array(face)
        if depth < 0:
            continue
        name = describe_direction((face[0], face[1], face[2]))
        if name in missing:
            axes.plot(x, y, "o", ms=9, mfc="none", mec=WARN, mew=1.2)
            axes.annotate(f"{name}: no position", (x, y), (0, -13), textcoords="offset points",
                          ha="center", color=WARN)  # fmt: skip
        else:
            axes.annotate(name, (x, y), (0, -12), textcoords="offset points", ha="center",
                          color=MUTED)  # fmt: skip
    for attitude in found:
        x, y, depth = screen @ attitude.unit_vector
        if depth < 0:
            continue
        if not isinstance(attitude.step, Turn | Rotation):
            axes.plot(x, y, "o", ms=6, mfc=Z, mec=PAPER, mew=0.6)
            if len(found) <= _MAX_NAMED:
                axes.annotate(attitude.step.label, (x, y), (0, 7), textcoords="offset points",
                              ha="center", color=INK)  # fmt: skip
        else:
            _draw_turn(axes, attitude, attitude.step.angle, screen)
    axes.set(xlim=(-1.12, 1.12), ylim=(-1.12, 1.12))
    axes.axis("off")
    seen = "+x +y +z" if side > 0 else "−x −y −z"
    axes.set_title(f"seen from {seen}", loc="center")
    return svg(figure, f"sphere{'p' if side > 0 else 'm'}", f"Attitudes covered, seen from {seen}")


def _draw_globe(axes: Axes, screen: Array) -> None:
    axes.add_patch(Circle((0, 0), 1.0, fc=BAND, ec=MUTED, lw=0.8))
    along = np.linspace(0, 2 * pi, 181)
    for k in range(3):
        ring = np.zeros((along.size, 3))
        ring[:, (k + 1) % 3], ring[:, (k + 2) % 3] = np.cos(along), np.sin(along)
        x, y, depth = screen @ ring.T
        axes.plot(np.where(depth >= 0, x, np.nan), y, color=FAINT, lw=0.8)


def _draw_turn(axes: Axes, attitude: MeasuredDirection, angle: float, screen: Array) -> None:
    """Draw an arrow around the axis, in the direction of the turn."""
    n = attitude.unit_vector
    first = np.cross(screen[0], n)
    first /= np.linalg.norm(first)
    second = np.cross(n, first)
    start = np.sign(angle) * np.linspace(-0.78 * pi, 0.78 * pi, 61)
    ring = cos(_RING_RADIUS) * n[:, None] + sin(_RING_RADIUS) * (
        np.outer(first, np.cos(start)) + np.outer(second, np.sin(start))
    )
    x, y, _ = screen @ ring
    axes.plot(x[:-1], y[:-1], color=INK, lw=1.0)
    axes.annotate("", (x[-1], y[-1]), (x[-4], y[-4]),
                  arrowprops={"arrowstyle": "-|>", "fc": INK, "ec": INK, "lw": 0.8,
                              "shrinkA": 0, "shrinkB": 0})  # fmt: skip
    axes.annotate(f"{attitude.step.label} {degrees(angle):+.0f}°".replace("-", "−"),
                  (float(x.mean()), float(y.min())), (0, -10), textcoords="offset points",
                  ha="center", color=INK)  # fmt: skip

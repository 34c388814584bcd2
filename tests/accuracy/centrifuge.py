"""A triad on a centrifuge's arm from the physics alone: nothing of inercal is imported.

In the frame of the arm (x outwards, y along the motion, z up) the sensor feels the centripetal
acceleration inwards and gravity's reaction upwards; with a lever arm r from the sensor's centre in
the body, and the arm turning, each axis sits at its own radius. Output = S (f + D f² + F f³) + b
along the unit input axes h, in units of output per g.
"""

from dataclasses import dataclass, field
from math import cos, pi, radians, sin

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
PAPER_G = 9.8  # m/s², the paper's unit of g
EARTH = 7.292115e-5  # rad/s


def _eye() -> Array:
    return np.eye(3)


def _zeros() -> Array:
    return np.zeros(3)


@dataclass(frozen=True, eq=False)
class Triad:
    """The paper's accelerometers: output units per g, output units, 1/g, 1/g²."""

    scale: Array = field(default_factory=lambda: np.array([1.29, 1.21, 1.26]))
    bias: Array = field(default_factory=lambda: np.array([0.213, 0.256, 0.516]))
    bend: Array = field(default_factory=lambda: np.array([0.57e-4, 0.31e-4, 0.45e-4]))
    cubic: Array = field(default_factory=_zeros)
    axes: Array = field(default_factory=_eye)  # rows are unit input axes in the body
    arms: Array = field(default_factory=lambda: np.zeros((3, 3)))  # m, of each axis, in the body

    def output(self, f: Array, up: Array | None = None, rate: Array | None = None) -> Array:
        """Return outputs (r, 3) at specific force (r, 3) in g.

        With the spindle's direction in the body, (r, 3), and the rate, (r,) rad/s, each axis feels
        −(ω²/g) h·(I − u uᵀ) r besides, at its place r on the arm.
        """
        along = f @ self.axes.T
        if up is not None and rate is not None:
            for i in range(3):
                level = self.arms[i] - up * (up @ self.arms[i])[:, None]
                along[:, i] -= rate**2 / PAPER_G * (level @ self.axes[i])
        return self.scale * (along + self.bend * along**2 + self.cubic * along**3) + self.bias


def printed_attitudes() -> list[tuple[float, float]]:
    """Return (ψ, θ) of the twenty printed positions, rad."""
    return [(radians(45 * i), radians(60 * j)) for i in range(5) for j in range(4)]


def full_circle() -> list[tuple[float, float]]:
    """Return (ψ, θ) of twenty positions all round: 72° steps from 10°, four θ."""
    return [
        (radians(10 + 72 * i), radians(theta)) for i in range(5) for theta in (20, 110, 200, 290)
    ]


def sensed_motion(
    attitudes: list[tuple[float, float]],
    rates: list[float],
    radius: float = 1.0,
    gravity: float = PAPER_G,
    earth_up: float = 0.0,
) -> tuple[Array, Array]:
    """Return specific force (r, 3) in units of PAPER_G and the rate of each row, rad/s."""
    rows: list[list[float]] = []
    spun: list[float] = []
    for rate in rates:
        a = (rate + earth_up) ** 2 * radius / PAPER_G
        g = gravity / PAPER_G
        for psi, theta in attitudes:
            rows.append(
                [
                    -a * cos(psi) * cos(theta) + g * sin(theta),
                    -a * sin(psi),
                    -a * cos(psi) * sin(theta) - g * cos(theta),
                ]
            )
            spun.append(rate)
    return np.array(rows), np.array(spun)


def ups(attitudes: list[tuple[float, float]], rates: list[float]) -> Array:
    """Return the spindle's direction in the body in each row of `felt`, (r, 3)."""
    return np.array([[sin(theta), 0.0, -cos(theta)] for _ in rates for _, theta in attitudes])


RATES = [2 * pi, 4 * pi, 6 * pi]

"""A plan: the steps that a bench carries out, the same in simulation and on iron.

A step's label names the section of the recording that it leaves.
"""

from dataclasses import dataclass
from math import pi

Vector = tuple[float, float, float]
AXES: dict[str, Vector] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class Hold:
    """Keep the sensor still with its body direction `up` (unit vector) against gravity."""

    label: str
    up: Vector
    seconds: float

    def in_words(self) -> str:
        """Return what to do: "−z up"."""
        return f"{direction(self.up)} up"


@dataclass(frozen=True)
class Turn:
    """Turn the sensor about its body direction `axis` (unit vector) by `angle`, rad.

    The axis stands vertical, up; a positive angle is counter-clockwise seen from above.
    """

    label: str
    axis: Vector
    angle: float
    seconds: float

    def in_words(self) -> str:
        """Return what to do: "turn by +360° about +z"."""
        return f"turn by {self.angle * 180 / pi:+.0f}° about {direction(self.axis)}"


Step = Hold | Turn


def direction(vector: Vector) -> str:
    """Return a body direction in words: "+x", "−z", or its components.

    >>> direction((0.0, 0.0, -1.0))
    '−z'
    """
    for name, axis in AXES.items():
        for sign, word in ((1, "+"), (-1, "−")):
            if all(abs(a - sign * b) < 1e-9 for a, b in zip(vector, axis, strict=True)):
                return word + name
    return "(" + ", ".join(f"{a:+.3g}" for a in vector) + ")"


def six_positions(seconds: float = 10.0) -> tuple[Hold, ...]:
    """Return the holds x_p, x_a, y_p, …: each axis up (p), then down (a)."""
    holds: list[Hold] = []
    for name, (x, y, z) in AXES.items():
        holds += [Hold(name + "_p", (x, y, z), seconds), Hold(name + "_a", (-x, -y, -z), seconds)]
    return tuple(holds)


def ferraris(seconds: float = 10.0, angle: float = 2 * pi, turn_seconds: float = 8.0):
    """Return the six holds and the turns x_rot, y_rot, z_rot (Ferraris et al. 1995)."""
    turns = [Turn(name + "_rot", axis, angle, turn_seconds) for name, axis in AXES.items()]
    return (*six_positions(seconds), *turns)

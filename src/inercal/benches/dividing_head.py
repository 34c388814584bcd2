"""A dividing head with its spindle level: two accelerometers turned through the plumb line.

At the position θ of the head the sensor stands at ψ, and feels in its own frame, with x and y in
the plane of rotation and z along the spindle::

    f = g (cos λ sin ψ, cos λ cos ψ, sin λ)
    ψ = θ + Δ(θ) + base + pier + level

so that x is level at 0°, up at 90°, and y a quarter turn on. λ is the spindle's lean out of the
level; `base` the angle of the head's zero against the plumb line, common to the run; `pier` the
tilt of the base at each position about it, of which a level on the base tells `level`.

The head errs by Δ: harmonics 1 and 2 of θ and a white part of each graduation. An autocollimator
before a polygon mirror on the spindle takes the head's place where it is used:

    "pairs"  180° is trimmed to what 0° read, 270° to what 90° read, in each pass: the angle of the
             second is that of the first and a difference of √2 times the autocollimator's deviation
    "every"  a polygon face at every position: each angle has the autocollimator's own error
    "none"   the head alone

The autocollimator stands on the base, and does not see it tilt.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import pi, sqrt
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from inercal.errors import InputError
from inercal.parameters import Parameter
from inercal.sensors import Axis, Sensor
from inercal.units import Measured

Array = NDArray[np.float64]
Collimated = Literal["pairs", "every", "none"]
HARMONICS = ("sin1", "cos1", "sin2", "cos2")
_SAME = 1e-9  # rad; closer angles are one position of the head


@dataclass(frozen=True)
class Index:
    """Turn the head to an angle and hold it there.

    Parameters
    ----------
    label : str
    angle : float
        Of the head, rad.
    sense : 1 or -1
        Of the pass: forward or reverse.
    level : float
        Tilt of the base about the spindle by a level on it, rad, in the sense of `angle`.
    seconds : float
        Length of the hold.
    """

    label: str
    angle: float
    sense: Literal[1, -1] = 1
    level: float = 0.0
    seconds: float = 0.0

    def in_words(self) -> str:
        """Return what to do: "head at 30°, forward"."""
        return f"head at {self.angle * 180 / pi:.4g}°, {'forward' if self.sense > 0 else 'reverse'}"


def positions(n: int = 12, *, reverse: bool = False, seconds: float = 0.0) -> tuple[Index, ...]:
    """Return n evenly spaced positions from 0, and on wish the same again backwards.

    Raises
    ------
    InputError
        No positions.
    """
    if n < 1:
        raise InputError(f"{n} positions on the head; at least one is needed")
    angles = [2 * pi * k / n for k in range(n)]
    forward = tuple(
        Index(f"f{k:02d}", angle, seconds=seconds) for k, angle in enumerate(angles, start=1)
    )
    if not reverse:
        return forward
    back = tuple(
        Index(f"r{k:02d}", angle, -1, seconds=seconds) for k, angle in enumerate(angles, start=1)
    )
    return (*forward, *back[::-1])


def mounted(name: str = "pair") -> Sensor:
    """Return two accelerometers as the fixture holds them: a along x, b along y.

    Both have P in the plane of rotation, a quarter turn on, and O along the spindle: each feels a
    mounting angle as δ_O and its in-plane cross term as K_ip.
    """
    x, y, back = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)
    return Sensor(name, (Axis("a", "f", x, y), Axis("b", "f", y, back)), form="tilted")


@dataclass(frozen=True)
class DividingHead:
    """The bench of a dividing head.

    Parameters
    ----------
    gravity : Measured
        Local gravity, m/s².
    harmonics : pair of float
        Standard deviations of the sine and cosine amplitude of harmonic 1, and of harmonic 2, rad.
    division : float
        Standard deviation of each graduation besides, rad.
    autocollimator : float
        Standard deviation of one reading, rad.
    collimated : "pairs", "every" or "none"
        Where the autocollimator is read.
    base : float
        Standard deviation of the zero of the head against the plumb line, rad.
    pier : float
        Standard deviation of the base's tilt at each position, beyond `Index.level`, rad.
    lean : float
        Standard deviation of the spindle's lean out of the level, rad.
    """

    gravity: Measured
    harmonics: tuple[float, float] = (0.0, 0.0)
    division: float = 0.0
    autocollimator: float = 0.0
    collimated: Collimated = "pairs"
    base: float = 0.0
    pier: float = 0.0
    lean: float = 0.0

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The imperfections, as data."""
        g, (first, second), one = self.gravity, self.harmonics, self.autocollimator
        pair = sqrt(2) * one
        return (
            Parameter("g", "m/s²", g.sd, "run", g.value, "local gravity"),
            Parameter("sin1", "rad", first, "run", 0.0, "head, sine of one turn"),
            Parameter("cos1", "rad", first, "run", 0.0, "head, cosine of one turn"),
            Parameter("sin2", "rad", second, "run", 0.0, "head, sine of half a turn"),
            Parameter("cos2", "rad", second, "run", 0.0, "head, cosine of half a turn"),
            Parameter("base", "rad", self.base, "run", 0.0, "zero of the head"),
            Parameter("lean", "rad", self.lean, "run", 0.0, "lean of the spindle"),
            Parameter("division", "rad", self.division, "position", 0.0, "graduation"),
            Parameter("trim", "rad", pair, "position", 0.0, "angle of a pair, trimmed"),
            Parameter("face", "rad", one, "position", 0.0, "autocollimator on a face"),
            Parameter("pier", "rad", self.pier, "position", 0.0, "tilt of the base"),
        )

    def nuisances(self, steps: Sequence[Index]) -> dict[str, Parameter]:
        """Return the parameters that act on these steps, by full name such as "division[f01]"."""
        acting = {name for row in _acting(self, steps) for name in row}
        found: dict[str, Parameter] = {}
        for parameter in self.parameters:
            if parameter.scope == "position":
                full = (f"{parameter.name}[{step.label}]" for step in steps)
                found |= {name: parameter for name in full if name in acting}
            elif parameter.name in acting or parameter.name in ("g", "lean"):
                found[parameter.name] = parameter
        return found


@dataclass(frozen=True, eq=False)
class Felt:
    """Specific force at each position, (..., r, 3) m/s², with derivatives.

    Parameters
    ----------
    f : (..., r, 3) array
        In the sensor's frame.
    by : mapping of str to (..., r, 3) array
        ∂f by each of the bench's parameters that act.
    """

    f: Array
    by: Mapping[str, Array] = field(default_factory=dict[str, Array])


def felt(bench: DividingHead, steps: Sequence[Index], q: Mapping[str, Array]) -> Felt:
    """Return the specific force at each position.

    Parameters
    ----------
    bench : DividingHead
    steps : sequence of r Index
    q : mapping of str to (...) array
        The bench's parameters by full name, SI; those missing are as declared.
    """
    declared = bench.nuisances(steps)
    value = {name: np.asarray(q.get(name, p.value)) for name, p in declared.items()}
    rows = _acting(bench, steps)
    weights = {
        name: np.array([row.get(name, 0.0) for row in rows])
        for name in dict.fromkeys(n for row in rows for n in row)
    }
    psi = np.array([step.angle + step.level for step in steps])
    for name, weight in weights.items():
        psi = psi + weight * value[name][..., None]
    g, lean = value["g"][..., None], value["lean"][..., None]
    sine, cosine = np.sin(psi), np.cos(psi)
    zero = np.zeros_like(psi)
    level = np.stack([sine, cosine, zero], axis=-1)
    turned = (g * np.cos(lean))[..., None] * np.stack([cosine, -sine, zero], axis=-1)
    along = np.array([0.0, 0.0, 1.0])
    unit = np.cos(lean)[..., None] * level + np.sin(lean)[..., None] * along
    leaning = -np.sin(lean)[..., None] * level + np.cos(lean)[..., None] * along
    by = {"g": unit, "lean": g[..., None] * leaning}
    by |= {name: weight[:, None] * turned for name, weight in weights.items()}
    return Felt(g[..., None] * unit, by)


def _acting(bench: DividingHead, steps: Sequence[Index]) -> list[dict[str, float]]:
    """Return how the angle of each step depends on the parameters, by full name."""
    by_angle: list[Index] = []
    rows: list[dict[str, float]] = []
    for step in steps:
        own = {"base": 1.0, f"pier[{step.label}]": 1.0}
        first = _trimmed_to(step, steps) if bench.collimated == "pairs" else None
        if bench.collimated == "every":
            own[f"face[{step.label}]"] = 1.0
        else:
            read = step if first is None else first
            # A graduation errs alike in both passes: it is named by the first step that reads it.
            same = next((other for other in by_angle if _apart(other, read) < _SAME), read)
            if same is read:
                by_angle.append(read)
            t = read.angle
            swing = (np.sin(t), np.cos(t), np.sin(2 * t), np.cos(2 * t))
            own |= dict(zip(HARMONICS, map(float, swing), strict=True))
            own[f"division[{same.label}]"] = 1.0
        if first is not None:
            own[f"trim[{step.label}]"] = 1.0
        rows.append(own)
    return rows


def _trimmed_to(step: Index, steps: Sequence[Index]) -> Index | None:
    """Return the step of the same pass whose reading the head was trimmed to, if any."""
    for second in (pi, 1.5 * pi):
        if _turn(step.angle - second) < _SAME:
            for other in steps:
                if other.sense == step.sense and _turn(other.angle - second + pi) < _SAME:
                    return other
    return None


def _apart(one: Index, other: Index) -> float:
    return _turn(one.angle - other.angle)


def _turn(angle: float) -> float:
    """Return the size of an angle beyond whole turns, rad."""
    return abs((angle + pi) % (2 * pi) - pi)

"""A dividing head with its spindle level: accelerometers turned through the plumb line.

At the position θ of the head the sensor stands at ψ, and feels in its own frame, with x and y in
the plane of rotation and z along the spindle::

    f = g (cos λ sin ψ, cos λ cos ψ, sin λ)
    ψ = θ + Δ(θ) + base + pier + level

so that x is level at 0°, up at 90°, and y a quarter turn on. λ is the spindle's lean out of the
level; `base` the angle of the head's zero against the plumb line, common to the run; `creep` and
`pier` the tilt of the base about it, steady over a pass and white, beyond what a level on the base
tells.

The head errs by Δ: harmonics of θ and a white part of each graduation. An autocollimator before a
polygon mirror on the spindle takes the head's place where it is used:

    "pairs"  180° is trimmed to what 0° read, 270° to what 90° read, in each pass: the angle of the
             second is that of the first and a difference of √2 times the autocollimator's deviation
    "every"  a polygon face at every position: each angle has the autocollimator's own error
    "none"   the head alone

Where it was read, and not brought to its mark, its readings count. Faces of the polygon deviate
from even angles by what its certificate states, within `certificate`. The autocollimator stands on
the base, and does not see it tilt.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot, isfinite, pi, sqrt
from typing import Literal

import numpy as np

from inercal.arrays import Array
from inercal.benches.contract import MeanMotion
from inercal.benches.dividing_head.head_angles import angle_weights, sensor_angles
from inercal.benches.dividing_head.passes import drift_ramps, pass_names
from inercal.benches.key_declarations import (
    declarations,
    declared_parameters,
    deviation,
    small_angle,
)
from inercal.errors import InputError
from inercal.motion import Motion
from inercal.parameters import Parameter, local_gravity
from inercal.plan import Index
from inercal.section_settings import Limit
from inercal.sensors import Axis, Noise, Readout, Sensor
from inercal.units import Measured

CollimationMode = Literal["pairs", "every", "none"]
_NOMINAL, _NOISELESS = Readout(), Noise()
_ROUNDED = 1e-15  # of a sine that is zero
_LARGEST_DRIFT = Limit(0.1, "a bias can drift, 10 mg")  # m/s²


def position_plan(n: int = 12, *, reverse: bool = False, seconds: float = 0.0) -> tuple[Index, ...]:
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


def mounted_sensor(
    name: str = "pair",
    axes: Sequence[str] = ("a", "b"),
    readout: Readout = _NOMINAL,
    noise: Noise = _NOISELESS,
) -> Sensor:
    """Return one or two accelerometers as the fixture holds them: the first along x, then y.

    All have P in the plane of rotation, a quarter turn on, and O along the spindle: each feels a
    mounting angle as δ_O and its in-plane cross term as K_ip.

    Raises
    ------
    InputError
        Other than one or two axes.
    """
    x, y, back = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)
    if not 1 <= len(axes) <= len(held := ((x, y), (y, back))):
        raise InputError(f"{len(axes)} accelerometers; the fixture holds one or two")
    result = (Axis(a, "f", i, p, readout, noise) for a, (i, p) in zip(axes, held, strict=False))
    return Sensor(name, tuple(result), form="tilted")


@dataclass(frozen=True)
class DividingHead:
    """The bench of a dividing head.

    Parameters
    ----------
    gravity : Measured
        Local gravity, m/s².
    harmonics : tuple of float
        Of harmonics 1, 2, … of the head's error: standard deviation of the amplitudes of sine and
        of cosine, rad each.
    division : float
        Standard deviation of each graduation besides, rad; it errs alike at each visit.
    autocollimator : float
        Standard deviation of one reading, rad.
    collimated : "pairs", "every" or "none"
        Where the autocollimator is read.
    polygon : tuple of float
        Certified deviation of each face from its even angle, rad; the first face is read at 0.
        Empty is even.
    certificate : float
        Standard deviation of each of these, rad.
    base : float
        Standard deviation of the zero of the head against the plumb line, rad.
    pier : float
        Standard deviation of the base's tilt at each position, beyond `Index.level`, rad.
    creep : float
        Standard deviation of the base's tilt over one pass, beyond `Index.level`, rad.
    lean : float
        Standard deviation of the spindle's lean out of the level, rad.
    drift : float
        Standard deviation of the drift of each accelerometer's bias over one pass, m/s².

    Raises
    ------
    InputError
        A gravity that is not positive, a deviation that is negative or not finite.
    """

    gravity: Measured
    harmonics: tuple[float, ...] = ()
    division: float = small_angle("1 ″", "graduation", scope="position")
    autocollimator: float = small_angle("0.1 ″", {})
    collimated: CollimationMode = "pairs"
    polygon: tuple[float, ...] = ()
    certificate: float = small_angle("0.1 ″", {"polygon": "face, as certified"}, scope="position")
    base: float = small_angle("10 ″", "zero of the head")
    pier: float = small_angle("0.1 ″", "tilt of the base", scope="position")
    creep: float = small_angle("0 ″", "tilt of the base over a pass", scope="pass", example="0.2 ″")
    lean: float = small_angle("20 ″", "lean of the spindle")
    drift: float = deviation(
        "m/s²", "0.5 µg", "drift of a bias over a pass", scope="pass", limit=_LARGEST_DRIFT
    )

    def __post_init__(self) -> None:
        if not (isfinite(self.gravity.value) and self.gravity.value > 0):
            raise InputError(f"dividing head: gravity is {self.gravity.value} m/s²; give it > 0")
        deviations = {"gravity": self.gravity.sd}
        deviations |= {f"harmonic {h}": sd for h, sd in enumerate(self.harmonics, start=1)}
        deviations |= {name: getattr(self, name) for name in declarations(DividingHead)}
        for what, sd in deviations.items():
            if not (isfinite(sd) and sd >= 0):
                raise InputError(f"dividing head: deviation of {what} is {sd}; give it 0 or more")
        if not all(isfinite(deviation) for deviation in self.polygon):
            raise InputError("dividing head: a deviation of a polygon's face is not finite")

    @property
    def rms(self) -> float:
        """The head's error without an autocollimator, root mean square, rad."""
        return sqrt(sum(sd**2 for sd in self.harmonics) + self.division**2)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The imperfections, as data."""
        g, one = self.gravity, self.autocollimator
        # A lean λ lowers the sensed motion by g λ²/2, of which the mean square is 3/4 (g sd²)².
        shortened = sqrt(0.75) * g.value * self.lean**2
        pair = sqrt(2) * one
        waves = [
            Parameter(f"{wave}{h}", "rad", sd, "run", 0.0, f"head, {words} of harmonic {h}")
            for h, sd in enumerate(self.harmonics, start=1)
            for wave, words in (("sin", "sine"), ("cos", "cosine"))
        ]
        return (
            replace(local_gravity(g), sd=hypot(g.sd, shortened)),
            *waves,
            *declared_parameters(self, "base", "lean", "division"),
            Parameter("trim", "rad", pair, "position", 0.0, "angle of a pair, trimmed"),
            Parameter("face", "rad", one, "position", 0.0, "autocollimator on a face"),
            *declared_parameters(self, "certificate", "pier", "creep", "drift"),
        )

    def nuisances(self, steps: Sequence[Index], sensor: Sensor) -> dict[str, Parameter]:
        """Return the parameters that act on these steps, by full name such as "division[f01]".

        The drift of each accelerometer is among them, "drift_a[pass 1]".
        """
        return self.acting_parameters(steps, sensor.channels)

    def acting_parameters(
        self, steps: Sequence[Index], channels: Sequence[str] = ()
    ) -> dict[str, Parameter]:
        """Return the same, with the drift of these channels alone."""
        named = {name for row in angle_weights(self, steps) for name in row}
        found: dict[str, Parameter] = {}
        for parameter in self.parameters:
            name = parameter.name
            if name == "drift":
                found |= {one: parameter for c in channels for one in drift_names(c, steps)}
            elif parameter.scope == "run":
                if name in named or name in ("g", "lean"):
                    found[name] = parameter
            else:
                labels = [step.label for step in steps]
                if parameter.scope == "pass":
                    labels = pass_names(steps)
                full = (f"{name}[{label}]" for label in labels)
                found |= {one: parameter for one in full if one in named}
        return found

    def simulated_parameters(
        self, steps: Sequence[Index], channels: Sequence[str] = ()
    ) -> dict[str, Parameter]:
        """Return `angle_weights` with the deviations that a simulation draws.

        `sensed_motion` holds the lean exactly. The share of gravity that stands for its second
        order, which a linear estimator lacks, would count it twice.
        """
        found = self.acting_parameters(steps, channels)
        return found | {"g": replace(found["g"], sd=self.gravity.sd)}

    def mean_motion(self, steps: Sequence[Index], q: Mapping[str, Array]) -> MeanMotion:
        """Return the mean motion at each position; see `inercal.benches.contract.MeanBench`."""
        return sensed_motion(self, steps, q)

    def reading_offsets(
        self, steps: Sequence[Index], sensor: Sensor, q: Mapping[str, Array]
    ) -> Array:
        """Return by how much the biases have drifted, (..., r, m) m/s²."""
        return bias_drift(steps, sensor.channels, q)


def drift_names(channel: str, steps: Sequence[Index]) -> list[str]:
    """Return the names of an accelerometer's drift in each pass."""
    return [f"drift_{channel}[{name}]" for name in pass_names(steps)]


def bias_drift(steps: Sequence[Index], channels: Sequence[str], q: Mapping[str, Array]) -> Array:
    """Return by how much the biases of m accelerometers have drifted, (..., r, m) m/s².

    Parameters
    ----------
    steps : sequence of r Index
    channels : sequence of m str
    q : mapping of str to (...) array
        The drifts by full name (`drift_names`), m/s² a pass.
    """
    result = drift_ramps(steps)
    by_axis = [
        np.stack([q.get(name, np.zeros(())) for name in drift_names(channel, steps)], axis=-1)
        @ result
        for channel in channels
    ]
    return np.stack(by_axis, axis=-1)


def sensed_motion(
    bench: DividingHead, steps: Sequence[Index], q: Mapping[str, Array]
) -> MeanMotion:
    """Return the specific force at each position, with its derivatives.

    Parameters
    ----------
    bench : DividingHead
    steps : sequence of r Index
    q : mapping of str to (...) array
        The bench's parameters by full name, SI; those missing are as declared.

    Raises
    ------
    InputError
        A collimated position on no face of the polygon.
    """
    psi, weights = sensor_angles(bench, steps)
    for name, weight in weights.items():
        if name in q:  # all others are zero
            psi = psi + weight * np.asarray(q[name])[..., None]
    g, lean = (
        np.asarray(q.get(name, at))[..., None]
        for name, at in (("g", bench.gravity.value), ("lean", 0.0))
    )
    # The sign of the sensed motion must not hang on how sin π is rounded.
    sine, cosine = (np.where(np.abs(x) < _ROUNDED, 0.0, x) for x in (np.sin(psi), np.cos(psi)))
    zero = np.zeros_like(psi)
    level = np.stack([sine, cosine, zero], axis=-1)
    turned = (g * np.cos(lean))[..., None] * np.stack([cosine, -sine, zero], axis=-1)
    along = np.array([0.0, 0.0, 1.0])
    unit = np.cos(lean)[..., None] * level + np.sin(lean)[..., None] * along
    leaning = -np.sin(lean)[..., None] * level + np.cos(lean)[..., None] * along
    by = {"g": unit, "lean": g[..., None] * leaning}
    by |= {name: weight[:, None] * turned for name, weight in weights.items()}
    return MeanMotion(Motion(g[..., None] * unit), by)

"""Describe a dividing head with a level spindle, which rotates sensors in a vertical plane.

At the head's angle θ the sensor is at the angle ψ. In its own frame, with x and y in the plane of
rotation and z along the spindle, it senses::

    f = g (cos λ sin ψ, cos λ cos ψ, sin λ)
    ψ = θ + Δ(θ) + base + pier + level

so that x is level at 0° and up at 90°, and y is a quarter turn ahead. λ is the spindle's lean from
the horizontal. `base` is the angle of the head's zero relative to the plumb line, common to the
run. `creep` (steady over a pass) and `pier` (white) are tilts of the base that a level on it does
not measure.

Δ is the error of the head: harmonics of θ and a white part at each graduation. An autocollimator
that faces a polygon mirror on the spindle can replace the head's scale:

    "pairs"  in each pass 180° is trimmed to the reading at 0°, and 270° to the reading at 90°; the
             error between the two angles of a pair is √2 times the autocollimator's deviation
    "every"  a polygon face is read at every position; each angle has the autocollimator's error
    "none"   only the head's scale is used

A reading of the autocollimator that was not brought to its mark corrects the angle. The certificate
states how much the angles of the polygon's faces deviate from equal spacing, with the standard
deviation `certificate`. The autocollimator is mounted on the base and does not measure its tilt.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot, isfinite, pi, sqrt
from typing import Literal

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.parameters import NOT_QUALIFIED, Parameter, QualifiedParameters, local_gravity
from inercal.basics.units import Measured
from inercal.benches.contract import MeanMotion, require_possible_values
from inercal.benches.dividing_head.passes import (
    angle_weights,
    drift_ramps,
    pass_names,
    sensor_angles,
)
from inercal.benches.key_declarations import (
    declarations,
    declared_parameters,
    deviation,
    small_angle,
)
from inercal.physics.motion import Motion
from inercal.physics.plan import Index
from inercal.physics.section_settings import Limit, key_error
from inercal.physics.sensors import Axis, Noise, Readout, Sensor, axes_along

CollimationMode = Literal["pairs", "every", "none"]
_NOMINAL, _NOISELESS = Readout(), Noise()
_ROUNDED = 1e-15  # rounding error of a sine that is zero
_LARGEST_DRIFT = Limit(0.1, "a bias can drift, 10 mg")  # m/s²


def position_plan(n: int = 12, *, reverse: bool = False, seconds: float = 0.0) -> tuple[Index, ...]:
    """Return n evenly spaced positions from 0; with `reverse`, followed by the same backwards.

    Raises
    ------
    InputError
        The number of positions is less than one.
    """
    if n < 1:
        raise key_error("n", f"is {n}; a plan needs at least one position")
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
    """Return one or two accelerometers as mounted in the fixture: the first along x, then y.

    Raises
    ------
    InputError
        The number of axes is neither one nor two.
    """
    if not 1 <= len(axes) <= len("xy"):
        raise key_error("axes", f"has {len(axes)} accelerometers; the fixture holds one or two")
    along = axes_along("xy"[: len(axes)], "f", "", readout, noise)
    named = [replace(axis, name=own) for axis, own in zip(along, axes, strict=True)]
    return sensor_in_plane(name, named)


def sensor_in_plane(name: str, axes: Sequence[Axis]) -> Sensor:
    """Return accelerometers with their P axes in the plane of rotation, a quarter turn ahead.

    The O axes are along the spindle. A mounting angle therefore acts as δ_O, and the in-plane cross
    term is K_ip.

    Raises
    ------
    InputError
        An axis is not in the plane of rotation.
    """
    for axis in axes:
        if axis.i[2]:
            raise InputError(
                f"axis {axis.name} has direction {list(axis.i)}, but the head turns about z; give "
                "directions across z, such as x, -y or [0.6, 0.8, 0]",
                key="[sensor.accelerometer] axis",
                names=(axis.name,),
            )
    turned = (replace(axis, p=(-axis.i[1], axis.i[0], 0.0)) for axis in axes)
    return Sensor(name, tuple(turned), form="tilted")


@dataclass(frozen=True)
class DividingHead:
    """A dividing head.

    Parameters
    ----------
    gravity : Measured
        Local gravity, m/s².
    harmonics : tuple of float
        Standard deviation of the sine and cosine amplitudes of harmonics 1, 2, … of the head's
        error, rad.
    division : float
        Standard deviation of the remaining error of a graduation, which is the same at each visit,
        rad.
    autocollimator : float
        Standard deviation of one reading of the autocollimator, rad.
    collimated : "pairs", "every" or "none"
        Positions at which the autocollimator is read.
    polygon : tuple of float
        Certified deviation of each face from equal spacing, rad; the first face is read at 0. If it
        is empty, the faces are assumed to be equally spaced.
    certificate : float
        Standard deviation of each certified deviation, rad.
    base : float
        Standard deviation of the head's zero relative to the plumb line, rad.
    pier : float
        Standard deviation of the base's tilt at each position that `Index.level` does not measure,
        rad.
    backlash : float
        Standard deviation of the difference between the angles that are reached forward and in
        reverse, rad.
    creep : float
        Standard deviation of the base's tilt over one pass that `Index.level` does not measure,
        rad.
    lean : float
        Standard deviation of the spindle's lean from the horizontal, rad.
    drift : float
        Standard deviation of the drift of each accelerometer's bias over one pass, m/s².
    qualified : QualifiedParameters
        Results of qualifications, whose values correct the angles.

    Raises
    ------
    InputError
        Gravity is not positive, or a standard deviation is negative or not finite.
    """

    gravity: Measured
    harmonics: tuple[float, ...] = ()
    division: float = small_angle("1 ″", "graduation", scope="position")
    autocollimator: float = small_angle("0.1 ″", {})
    collimated: CollimationMode = "pairs"
    polygon: tuple[float, ...] = ()
    certificate: float = small_angle(
        "0.1 ″", {"polygon": "certified deviation of a face"}, scope="position"
    )
    base: float = small_angle("10 ″", "zero of the head")
    pier: float = small_angle("0.1 ″", "tilt of the base", scope="position")
    backlash: float = small_angle("0 ″", "backlash of the head", example="0.2 ″")
    creep: float = small_angle("0 ″", "tilt of the base over a pass", scope="pass", example="0.2 ″")
    lean: float = small_angle("20 ″", "lean of the spindle")
    drift: float = deviation(
        "m/s²", "0.5 µg", "drift of a bias over a pass", scope="pass", limit=_LARGEST_DRIFT
    )
    qualified: QualifiedParameters = NOT_QUALIFIED

    def __post_init__(self) -> None:
        deviations = {"gravity": self.gravity.sd}
        deviations |= {f"harmonic {h}": sd for h, sd in enumerate(self.harmonics, start=1)}
        deviations |= {name: getattr(self, name) for name in declarations(DividingHead)}
        require_possible_values("dividing head", {"gravity": self.gravity.value}, deviations)
        if not all(map(isfinite, self.polygon)):
            raise InputError(
                f"dividing head: polygon has the deviations {self.polygon}; each must be finite",
                key="polygon",
            )

    @property
    def rms(self) -> float:
        """Root mean square of the head's error without an autocollimator, rad."""
        return sqrt(sum(sd**2 for sd in self.harmonics) + self.division**2)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The imperfections of the bench, as data."""
        g = self.gravity
        # A lean λ reduces the sensed gravity by g λ²/2, whose mean square is 3/4 (g sd²)².
        shortened = sqrt(0.75) * g.value * self.lean**2
        read = self.autocollimator
        waves = [
            Parameter(f"{wave}{h}", "rad", sd, "run", 0.0, f"head, {words} of harmonic {h}")
            for h, sd in enumerate(self.harmonics, start=1)
            for wave, words in (("sin", "sine"), ("cos", "cosine"))
        ]
        stated = (
            replace(local_gravity(g), sd=hypot(g.sd, shortened)),
            *waves,
            *declared_parameters(self, "base", "lean", "division"),
            Parameter("trim", "rad", sqrt(2) * read, "position", 0.0, "trimmed angle of a pair"),
            Parameter("face", "rad", read, "position", 0.0, "autocollimator reading on a face"),
            *declared_parameters(self, "certificate", "pier", "backlash", "creep", "drift"),
        )
        return self.qualified.apply(stated, corrected=True)

    def nuisances(self, steps: Sequence[Index], sensor: Sensor) -> dict[str, Parameter]:
        """Return the parameters that act on these steps, by full name such as "division[f01]".

        The parameters include the drift of each accelerometer, such as "drift_a[pass 1]".
        """
        return self.acting_parameters(steps, sensor.channels)

    def acting_parameters(
        self, steps: Sequence[Index], channels: Sequence[str] = ()
    ) -> dict[str, Parameter]:
        """Return the parameters that act on these steps, with the drift of these channels only."""
        acting = {name for row in angle_weights(self, steps) for name in row} | {"g", "lean"}
        labels = {"position": [step.label for step in steps], "pass": pass_names(steps)}
        result: dict[str, Parameter] = {}
        for parameter in self.parameters:
            name = parameter.name
            if name == "drift":
                names = [full for c in channels for full in drift_names(c, steps)]
            elif parameter.scope == "run":
                names = [name] if name in acting else []
            else:
                full_names = [f"{name}[{label}]" for label in labels[parameter.scope]]
                names = [full for full in full_names if full in acting]
            result |= dict.fromkeys(names, parameter)
        return result

    def simulated_parameters(
        self, steps: Sequence[Index], channels: Sequence[str] = ()
    ) -> dict[str, Parameter]:
        """Return the acting parameters with the standard deviations that a simulation draws.

        For linear estimators, the standard deviation of gravity includes the second-order effect of
        the lean. `sensed_motion` is exact in the lean, so this part is removed here; otherwise it
        would count twice.
        """
        result = self.acting_parameters(steps, channels)
        return result | {"g": replace(result["g"], sd=self.gravity.sd)}

    def mean_motion(self, steps: Sequence[Index], q: Mapping[str, Array]) -> MeanMotion:
        """Return the mean motion at each position; see `inercal.benches.contract.MeanBench`."""
        return sensed_motion(self, steps, q)

    def reading_offsets(
        self, steps: Sequence[Index], sensor: Sensor, q: Mapping[str, Array]
    ) -> Array:
        """Return the drift of the biases, (..., r, m) m/s²."""
        return bias_drift(steps, sensor.channels, q)


def drift_names(channel: str, steps: Sequence[Index]) -> list[str]:
    """Return the parameter names of an accelerometer's drift in each pass."""
    return [f"drift_{channel}[{name}]" for name in pass_names(steps)]


def bias_drift(steps: Sequence[Index], channels: Sequence[str], q: Mapping[str, Array]) -> Array:
    """Return the drift of the biases of m accelerometers, (..., r, m) m/s².

    Parameters
    ----------
    steps : sequence of r Index
    channels : sequence of m str
    q : mapping of str to (...) array
        The drifts by full name (`drift_names`), m/s² per pass.
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
        The bench's parameters, SI, by full name. A missing parameter keeps its stated value.

    Raises
    ------
    InputError
        The polygon has no face at a position where the autocollimator is read.
    """
    psi, weights = sensor_angles(bench, steps)
    for name, weight in weights.items():
        if name in q:  # all others are zero
            psi = psi + weight * np.asarray(q[name])[..., None]
    g, lean = (
        np.asarray(q.get(name, at))[..., None]
        for name, at in (("g", bench.gravity.value), ("lean", 0.0))
    )
    # The sign of the sensed motion must not depend on the rounding error of sin π.
    sine, cosine = (np.where(np.abs(x) < _ROUNDED, 0.0, x) for x in (np.sin(psi), np.cos(psi)))
    lean = lean + bench.qualified.correction("lean")
    zero = np.zeros_like(psi)
    level = np.stack([sine, cosine, zero], axis=-1)
    turned = (g * np.cos(lean))[..., None] * np.stack([cosine, -sine, zero], axis=-1)
    along = np.array([0.0, 0.0, 1.0])
    unit = np.cos(lean)[..., None] * level + np.sin(lean)[..., None] * along
    leaning = -np.sin(lean)[..., None] * level + np.cos(lean)[..., None] * along
    by = {"g": unit, "lean": g[..., None] * leaning}
    by |= {name: weight[:, None] * turned for name, weight in weights.items()}
    return MeanMotion(Motion(g[..., None] * unit), by)


def bench_covariance(
    sensor: Sensor,
    bench: DividingHead,
    steps: Sequence[Index],
    c: Array | None = None,
    *,
    gravity: bool = True,
) -> Array:
    """Return the covariance of all readings due to the bench's angles and gravity.

    The matrix is (m r, m r) in (m/s²)², ordered row by row like `Observations.full_covariance`.

    Parameters
    ----------
    sensor : Sensor
    bench : DividingHead
    steps : sequence of r Index
    c : (p,) array, optional
        Coefficients of the sensor; None means a nominal sensor.
    gravity : bool
        Whether the uncertainty of gravity is included.
    """
    declared = bench.acting_parameters(steps)
    columns = [
        declared[name].sd * column
        for name, column in reading_sensitivities(sensor, bench, steps, c).items()
        if gravity or name != "g"
    ]
    size = len(sensor.channels) * len(steps)
    return sum((np.outer(column, column) for column in columns), np.zeros((size, size)))


def reading_sensitivities(
    sensor: Sensor, bench: DividingHead, steps: Sequence[Index], c: Array | None = None
) -> dict[str, Array]:
    """Return the readings' derivatives, (m r,), with respect to each parameter that is not exact.

    The arguments are the same as for `bench_covariance`. To get the derivative of an estimate with
    respect to a stated value of the bench, multiply its derivative with respect to the readings by
    this one, and change the sign.
    """
    result = sensed_motion(bench, steps, {})
    c = np.zeros(len(sensor.coefficients)) if c is None else c
    slope = sensor.slope(Motion(result.f), c)[..., :3]
    return {
        name: (slope @ result.df[name][..., None]).ravel()
        for name, q in bench.acting_parameters(steps).items()
        if q.sd > 0
    }

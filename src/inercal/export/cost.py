"""Find the loss of accuracy in an export: compare its correction with `Calibration.correct`.

The calibration's own model computes the output for motions that fill the calibrated range. The
error is the motion that the target computes from this output, minus the motion that `correct`
computes. U is the expanded uncertainty (k = 2) of the result of `correct`, from the calibration's
covariance::

    u²(x) = J C Jᵀ,   J = −(∂y/∂x)⁻¹ ∂y/∂c
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import nan

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, NotInvertible
from inercal.calibration import Calibration
from inercal.estimation.uncertainty import COVERAGE
from inercal.export.model import ExportModel
from inercal.export.ranges import Ranges, sample_motions
from inercal.export.target_definition import Rendering, Target
from inercal.export.term_kinds import DERIVATIVES, WORDS, kinds_of
from inercal.physics.frames import exp_so3
from inercal.physics.motion import Motion
from inercal.physics.quantities import KINDS, QUANTITIES, Measures
from inercal.physics.sensors import Sensor
from inercal.physics.sensors.coefficient_tables import Basis

_DIP = np.radians(65.0)  # dip of the field in middle latitudes
_FLOAT32 = 2.0**-24
_ROUNDINGS = 16  # rounding errors of a single-precision target, which adds a few products


@dataclass(frozen=True)
class Cost:
    """The error of an export for one kind of motion.

    Parameters
    ----------
    measures : "f", "w" or "m"
    largest, rms : float
        Largest and rms error of a component over the range, m/s², rad/s or T.
    expanded : float
        U (k = 2) of the correction at the point where the error is largest; NaN if the calibration
        does not determine the bias.
    exceeds : bool
        Whether the error of a component exceeds both its U and the rounding error somewhere in the
        range.
    """

    measures: Measures
    largest: float
    rms: float
    expanded: float
    exceeds: bool


@dataclass(frozen=True)
class Loss:
    """Terms that the target cannot represent.

    Parameters
    ----------
    measures : "f", "w" or "m"
    word : str
        Word for the terms, such as "misalignment".
    names : tuple of str
        Names of the coefficients.
    effect : float
        Largest effect of the terms on a reading over the range, m/s², rad/s or T; NaN if
        unknown.
    unknown : str
        Reason why the effect is unknown; otherwise empty.
    """

    measures: Measures
    word: str
    names: tuple[str, ...]
    effect: float
    unknown: str = ""

    def effect_text(self, size: str = "") -> str:
        """Describe the effect, with its size as given; by default, in SI units as ASCII text."""
        if self.unknown:
            return f"effect unknown: {self.unknown}"
        size = size or f"{self.effect:.3g} {QUANTITIES[self.measures].ascii_unit}"
        return f"up to {size} over the range"


@dataclass(frozen=True, eq=False)
class Samples:
    """Motions that fill the range, each with its reading and its correction.

    Parameters
    ----------
    motion : Motion
    readings : (n, k) array
        Readings of the target's channels, SI.
    corrected : (n, k) array
        Result of `Calibration.correct`, in the target's axes.
    dT : (n,) array
        Temperature difference from the reference, K.
    """

    motion: Motion
    readings: Array
    corrected: Array
    dT: Array


def sample(model: ExportModel, ranges: Ranges) -> Samples:
    """Return motions over the ranges, with the calibration's readings and corrections.

    Raises
    ------
    InputError
        The model has no inverse somewhere in the ranges.
    """
    sensor = model.sensor
    motion = sample_motions(model.calibration, ranges)
    y = sensor.forward(motion, model.calibration.values)
    return _corrected(model, motion, np.broadcast_to(y, (len(motion.f), y.shape[-1])))


def possible_samples(
    model: ExportModel, samples: Samples, possible: Callable[[Array], Array]
) -> Samples:
    """Return samples with readings that are rounded to values that the target accepts."""
    readings = possible(samples.readings)
    y = np.zeros((len(readings), len(model.sensor.axes)))
    for k, (_, triad) in enumerate(model.triads):
        y[:, list(triad.rows)] = readings[:, 3 * k : 3 * k + 3] * triad.signs
    return _corrected(model, samples.motion, y)


def _corrected(model: ExportModel, motion: Motion, y: Array) -> Samples:
    """Return samples for readings y of the sensor's axes in SI, (n, m)."""
    calibration, sensor = model.calibration, model.sensor
    output = sensor.to_output(y)
    dT = np.broadcast_to(np.asarray(motion.dT, dtype=float), y.shape[:1])
    try:
        back = calibration.correct(output, dw=np.zeros((1, 3)), dT=dT, dTdt=0.0)
    except NotInvertible as error:
        raise InputError(
            f"over the calibrated range the model of {sensor.name} has no inverse ({error}); "
            "give smaller ranges with --over-force and --over-rate"
        ) from None
    return Samples(motion, model.readings(output), model.motion(back), dT)


def costs(
    model: ExportModel, samples: Samples, correct: Callable[[Array, Array], Array]
) -> tuple[Cost, ...]:
    """Return the errors of a target's correction for each kind of motion."""
    error = correct(samples.readings, samples.dT) - samples.corrected
    expanded = _expanded(model, samples)
    found: list[Cost] = []
    for k, (kind, _) in enumerate(model.triads):
        mine, limits = error[:, 3 * k : 3 * k + 3], expanded[:, 3 * k : 3 * k + 3]
        size = float(np.abs(samples.corrected[:, 3 * k : 3 * k + 3]).max())
        rounding = _ROUNDINGS * _FLOAT32 * size
        at = np.unravel_index(int(np.abs(mine).argmax()), mine.shape)
        found.append(
            Cost(
                kind,
                float(np.abs(mine).max()),
                float(np.sqrt(np.mean(mine**2))),
                float(limits[at]),
                bool((np.abs(mine) > np.maximum(limits, rounding)).any()),
            )
        )
    return tuple(found)


def losses(
    model: ExportModel, samples: Samples, target: Target, rendering: Rendering
) -> tuple[Loss, ...]:
    """Return the terms of a calibration that a target cannot represent, and their effects."""
    holds = target.holds if rendering.holds is None else rendering.holds
    sensor, values = model.sensor, model.calibration.values
    complete = sensor.forward(samples.motion, values)
    warmed = bool(np.any(samples.dT))
    groups: dict[tuple[Measures, str, str], list[int]] = {}
    for k, (measures, kind, order) in enumerate(kinds_of(sensor)):
        held = kind in holds.get(measures, ())
        if kind == "bias_temperature" and order > target.temperature_order:
            held = False
        basis = sensor.coefficient(sensor.coefficients[k]).basis
        unknown = ""
        if unmeasured := _unmeasured(sensor, basis):
            held, unknown = False, f"the sensor does not measure {unmeasured}"
        elif kind in DERIVATIVES:
            unknown = f"no range of {DERIVATIVES[kind]} is stated"
        elif basis.uses("dT") and not warmed:
            unknown = "no range of temperature is stated"
        if not held:
            groups.setdefault((measures, WORDS[kind], unknown), []).append(k)
    found: list[Loss] = []
    for (measures, word, unknown), members in groups.items():
        names = tuple(sensor.coefficients[k] for k in members)
        if unknown and values[members].any():
            found.append(Loss(measures, word, names, nan, unknown))
            continue
        less = values.copy()
        less[members] = 0.0
        change = complete - sensor.forward(samples.motion, less)
        found.append(Loss(measures, word, names, float(np.abs(change).max())))
    if rendering.rotation is not None:
        found.append(_lost_rotation(model, samples, rendering.rotation))
    return tuple(found)


def _lost_rotation(model: ExportModel, samples: Samples, rotation: Array) -> Loss:
    """Return the loss of the rotation Q in D = P Q, as a rotation vector in the target's axes."""
    lost = np.eye(3) - exp_so3(rotation)
    effect = float(np.abs(samples.motion.m @ model.turn.T @ lost.T).max())
    heading = np.degrees(abs(rotation[2]) + np.tan(_DIP) * np.hypot(*rotation[:2]))
    vector = ", ".join(f"{x:.2f}" for x in np.degrees(rotation))
    word = (
        f"rotation between magnetometers and body by the vector ({vector}) deg, up to "
        f"{heading:.1f} deg of heading of a level sensor at a dip of {np.degrees(_DIP):.0f} deg"
    )
    names = model.sensor.select_axes("m").coefficients
    return Loss("m", word, tuple(name for name in names if ".delta_" in name), effect)


def _unmeasured(sensor: Sensor, basis: Basis) -> str:
    """Return a quantity in a term that no axis of the sensor measures, or ""."""
    kinds = {axis.measures for axis in sensor.axes}
    if "f" not in kinds and basis.uses("fi", "fp", "fo", "si"):
        return "specific force"
    if "w" not in kinds and basis.uses("wi", "wp", "wo", "swi"):
        return "angular rate"
    return ""


def _expanded(model: ExportModel, samples: Samples) -> Array:
    """Return U (k = 2) of the result of `correct` in the target's axes, (n, k)."""
    by = propagation(model, samples.motion)
    rows = by.reshape(-1, by.shape[-1])  # one large product is faster than one for each sample
    variance = ((rows @ model.calibration.covariance) * rows).sum(axis=-1).reshape(by.shape[:-1])
    return COVERAGE * np.sqrt(np.maximum(variance, 0.0))


def propagation(model: ExportModel, motion: Motion) -> Array:
    """Return −∂x/∂c of the corrected motion x in the target's axes, (n, k, p), SI.

    Parameters
    ----------
    model : ExportModel
    motion : Motion
        The true motions, with n temperature differences.
    """
    calibration: Calibration = model.calibration
    kinds = [kind for kind, _ in model.triads]
    sensor = calibration.sensor
    columns = [k for k in range(sensor.width) if KINDS[k // 3] in kinds]
    lines = sensor.linearise(motion, calibration.values)
    n = np.size(motion.dT)
    slope = np.broadcast_to(lines.slope, (n, *lines.slope.shape[-2:]))[..., columns]
    design = np.broadcast_to(lines.design, (n, *lines.design.shape[-2:]))
    by = np.linalg.solve(slope, design)
    return np.kron(np.eye(len(kinds)), model.turn) @ by

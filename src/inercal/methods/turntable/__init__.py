"""Provide what the turntable methods share, such as the model of a triad and its attitude.

The methods are `turntable_kalman`, `turntable_discrete` and `turntable_trajectory`.

The remarks on a fit name turntable parameters that are far from their values in the run file.

The coefficients of a triad are described for compiled filters, with their effects on readings.

A reading is affine in the coefficients, and its terms are of second degree in the sensed motion::

    y = N u + Σ_m c_m e_a(m) (T_m · φ(f, ω)),   φ = (1, f, ω, fx², fy², fz², fx fy, fx fz, fy fz)

where u is f or ω, and e_a is the axis that coefficient m belongs to. If the sensor depends on
temperature, φ also contains ΔT times all of these, and ΔT².
"""

from collections.abc import Mapping
from dataclasses import replace
from math import degrees, radians, sqrt
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.basics.errors import InputError
from inercal.basics.parameters import Parameter
from inercal.basics.units import format_quantity
from inercal.benches.turntable.bench import Turntable
from inercal.calibration.next_steps import COARSE_READINGS
from inercal.estimation import Estimate
from inercal.methods import Fit, Remarks
from inercal.physics.motion import Motion
from inercal.physics.plan import TableStep
from inercal.physics.quantities import Measures
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Finding, Track

# Standard deviations: with twenty correctly stated parameters, one run in 800 has such a deviation
_MAX_DEVIATION_SD = 4.0
_MAX_SD_RATIO = 0.8  # of the stated deviation; above it, under a third of the weight is from data
_SOURCE_BIAS_SD = radians(0.004) / 60  # rad/s
_ROUNDING = "U does not include the rounding errors of the readings"
_BENCH_KEYS = {
    "lean_x": "lean", "lean_y": "lean", "square_1": "square", "square_2": "square",
    "azimuth": "azimuth", "latency": "latency", "clock": "clock", "g": "gravity",
}  # fmt: skip
_UNITS = {"s": "ms", "1": "ppm", "m": "mm", "m/s²": "m/s²"}
_TRIAD = ("bias", "scale", "misalignment")
DEFAULT_COEFFICIENTS: Mapping[Measures, tuple[str, ...]] = {"f": _TRIAD, "w": _TRIAD}
FURTHER_COEFFICIENTS: Mapping[Measures, tuple[str, ...]] = {
    "f": ("k2", "temperature"),
    "w": ("g", "temperature"),
}


def remarks(fit: Fit[Turntable, TableStep]) -> Remarks:
    """Return findings on stated values and, for the source's estimator, a note on the noise."""
    if not np.all(fit.estimate.converged):
        return Remarks()
    track, notes = fit.observations.track, ()
    if fit.estimator == "paper" and track is not None and fit.sensor.select_axes("w").axes:
        notes = (source_noise_note(fit.sensor, track),)
    stated = fit.bench.nuisances(fit.steps, fit.sensor)
    return Remarks(stated_value_findings(fit.estimate, stated), notes)


def remarks_on_samples(fit: Fit[Turntable, TableStep]) -> Remarks:
    """Return the remarks of a method that takes the errors of successive samples as independent."""
    found, rounding = remarks(fit), fit.observations.rounding
    if rounding is None or not rounding.channels:
        return found
    finding = Finding("note", COARSE_READINGS, f"{_ROUNDING}; use turntable_discrete")
    return found._replace(
        findings=(finding, *found.findings), notes=(*found.notes, f"{_ROUNDING}.")
    )


def source_noise_note(sensor: Sensor, track: Track) -> str:
    """Return a note on the smallest gyro bias uncertainty that the noise allows in the last rest.

    The source states 0.004 °/min from a rest of 72 s.
    """
    held = track.time[track.hold == track.hold.max()]
    seconds = float(held[-1] - held[0])
    white = max(axis.noise.white for axis in sensor.axes if axis.measures == "w")
    least, needed = (
        degrees(x) * 60 for x in (white / sqrt(seconds), _SOURCE_BIAS_SD * sqrt(seconds))
    )
    return (
        f"Because of the gyros' noise, the last rest of {seconds:.3g} s determines each bias only "
        f"with u = {least:.2g} °/min; the source's 0.004 °/min needs a noise below "
        f"{needed:.2g} °/√h."
    )


def stated_value_findings(
    estimate: Estimate, expected: Mapping[str, Parameter]
) -> tuple[Finding, ...]:
    """Return a warning for each table parameter that is far from its stated value.

    Parameters
    ----------
    estimate : Estimate
        Estimate without a trial axis.
    expected : mapping of str to Parameter
        The table's parameters by name, with their stated values.
    """
    found: list[Finding] = []
    for name, value, sd in zip(
        estimate.names, estimate.value.tolist(), estimate.std.tolist(), strict=True
    ):
        stated = expected.get(name)
        if stated is None or not stated.sd > 0 or sd > _MAX_SD_RATIO * stated.sd:
            continue
        # The shift due to the data relative to its standard deviation, without the prior's share.
        pull = abs(value - stated.value) / sqrt(stated.sd**2 - sd**2)
        if pull > _MAX_DEVIATION_SD:
            unit = _UNITS.get(stated.unit) or ("″" if abs(value) + stated.sd < 1e-3 else "°")
            key = _BENCH_KEYS.get(name) or ("lever" if name.startswith("lever") else "harmonics")
            text = (
                f"{stated.meaning}: the data give {format_quantity(value, sd, unit)}, but "
                f"{format_quantity(stated.value, stated.sd, unit)} is stated ({pull:.1f} standard "
                f"deviations away); check [bench] {key}"
            )
            found.append(Finding("warning", "bench", text.replace("-", "−")))
    return tuple(found)


BASIS = 13
BIAS, FORCE, RATE, SQUARE = 0, 1, 4, 7  # indices at which 1, f, ω and products of f begin in φ
TEMPERATURE = BASIS  # index of ΔT times all of these, before ΔT²


class Terms(NamedTuple):
    """The terms for three axes and p coefficients."""

    nominal: Array  # N, (3, 3)
    axis: Indices  # a(m), (p,)
    weights: Array  # T, (p, BASIS), or (p, 2 BASIS + 1) if the sensor depends on temperature
    first: int  # index of u in φ

    @property
    def bias(self) -> Bools:
        """Which coefficients are biases, (p,)."""
        return np.abs(self.weights) @ (np.arange(self.size) != BIAS) == 0

    @property
    def size(self) -> int:
        """Number of terms in φ."""
        return self.weights.shape[1]

    @property
    def has_temperature(self) -> bool:
        """Whether terms with ΔT are included."""
        return self.size > BASIS


def basis(motion: Motion) -> Array:
    """Return φ for a motion, without ΔT, (n, BASIS)."""
    f, w = np.broadcast_arrays(motion.f, motion.w)
    x, y, z = f.T
    one = np.ones_like(x)
    return np.stack([one, x, y, z, *w.T, x * x, y * y, z * z, x * y, x * z, y * z], axis=-1)


def terms(sensor: Sensor) -> Terms:
    """Return the terms for a triad of accelerometers or of gyros.

    Raises
    ------
    InputError
        There are not three axes of one kind, or the form or some coefficients are unsuitable.
    """
    kinds = {axis.measures for axis in sensor.axes}
    if len(sensor.axes) != 3 or len(kinds) != 1:
        axes = tuple(axis.name for axis in sensor.axes)
        raise InputError(
            f"sensor {sensor.name} has axes {', '.join(axes)}, but the method needs three "
            "accelerometers or three gyros",
            names=axes,
        )
    if sensor.form != "reference":
        raise InputError(
            f'sensor {sensor.name} has form = "{sensor.form}", but the method needs form = '
            '"reference"',
            key="form",
        )
    rng = np.random.default_rng(0)
    motion = Motion(G0 * rng.standard_normal((40, 3)), rng.standard_normal((40, 3)))
    probes = basis(motion)
    if sensor.uses("dT"):
        warmth = 10 * rng.standard_normal(len(probes))
        motion = replace(motion, dT=warmth)
        probes = np.column_stack([probes, warmth[:, None] * probes, warmth**2])
    scale = np.abs(probes).max(axis=0)
    p = len(sensor.coefficients)
    result = sensor.linearise(motion, np.zeros(p))
    back = np.asarray(np.linalg.pinv(probes / scale), dtype=float) / scale[:, None]
    whole = back @ result.reading  # (size of φ, 3)
    first = FORCE if kinds == {"f"} else RATE
    design = np.einsum("bn,nap->pab", back, result.design)
    axis = np.abs(design).max(axis=-1).argmax(axis=-1)
    weights = design[np.arange(p), axis]
    weights[np.abs(weights) < 1e-9] = 0.0
    away = result.design - np.einsum("nb,pb,ap->nap", probes, weights, np.eye(3)[:, axis])
    beyond = np.abs(away).max(axis=(0, 1)) > 1e-9 * np.abs(result.design).max(axis=(0, 1))
    if beyond.any():
        names = tuple(n for n, bad in zip(sensor.coefficients, beyond, strict=True) if bad)
        raise InputError(
            f"{sensor.name}: the method cannot estimate the coefficients {', '.join(names)}; remove"
            " them",
            names=names,
        )
    return Terms(whole[first : first + 3].T.copy(), axis, weights, first)

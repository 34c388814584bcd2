"""Provide what the turntable methods share, such as the model of a triad and its attitude.

The methods are `turntable_kalman`, `turntable_discrete` and `turntable_trajectory`.

The remarks on a fit name turntable parameters that are far from their values in the run file.
"""

from collections.abc import Mapping
from math import degrees, radians, sqrt

import numpy as np

from inercal.basics.parameters import Parameter
from inercal.basics.units import format_quantity
from inercal.benches.turntable.bench import Turntable
from inercal.calibration.verdict import COARSE_READINGS
from inercal.estimation import Estimate
from inercal.methods import Fit, Remarks
from inercal.physics.plan import TableStep
from inercal.physics.quantities import Measures
from inercal.physics.sensors import Sensor
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

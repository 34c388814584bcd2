"""Advice on how to improve a multi_position result."""

# pyright: reportMissingTypeStubs=false

import numpy as np
import scipy

from inercal.basics.arrays import Array
from inercal.basics.run_file_advice import Change
from inercal.basics.units import format_value_and_uncertainty
from inercal.estimation import Estimate
from inercal.estimation.uncertainty.coverage import COVERAGE
from inercal.methods.multi_position.attitude_coverage import (
    GeometryErrors,
    attitudes_in_words,
    next_attitudes,
)
from inercal.methods.multi_position.rest_observations import Rests
from inercal.physics.earth import COMPUTED_GRAVITY_SD
from inercal.recordings import Finding

_MIN_IMPROVEMENT = 1.5  # times: less gain is not worth the hand's trouble
_ADVISED_ATTITUDES = 3  # attitudes advised where a result is weak
_SHARED = ("g", "timebase")  # parameters of the bench whose errors all coefficients share
_TEST_LEVEL = 1e-3  # that rates without a sensitivity look like it


def advice(rests: Rests, estimate: Estimate) -> tuple[str, ...]:
    """Return attitudes to add and the resulting uncertainty, where they would reduce it much.

    Computed from the information matrix, with the estimated noise and scatter.
    """
    sensor, p = rests.sensor, len(rests.sensor.coefficients)
    unit_scale = sensor.unit_scale
    # More attitudes do not reduce the parts of gravity and of the recording's clock.
    shared = np.stack([_shifts(estimate, name)[:p] / unit_scale for name in _SHARED])
    covariance = estimate.covariance[:p, :p] / np.outer(unit_scale, unit_scale)
    covariance -= shared.T @ shared
    sizes = {group.name: float(np.sqrt(np.mean(group.sd**2))) for group in estimate.groups}
    typical = GeometryErrors(*(sizes.get(name, 1.0) for name in ("norms", "rates", "rotations")))
    ups = rests.norms(np.concatenate([estimate.value[:p], rests.start()[p:]])).up
    before = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
    more, after = next_attitudes(
        sensor,
        before,
        ups[-1],
        rests.bench.gravity.value,
        typical,
        target_deviation=0.0,
        max_attitudes=_ADVISED_ATTITUDES,
    )
    stays = (shared**2).sum(axis=0)
    old = np.sqrt(np.diag(covariance) + stays) * unit_scale
    new = np.sqrt(np.diag(np.linalg.inv(after)) + stays) * unit_scale
    k = int(np.argmax(old / new))
    if old[k] < _MIN_IMPROVEMENT * new[k]:
        return ()
    name = sensor.coefficients[k]
    line = sensor.coefficient(name)
    sizes_told = [
        format_value_and_uncertainty(0.0, COVERAGE * float(sd[k]) / line.si)[1] for sd in (old, new)
    ]
    return (
        f"{name} is known poorly: {attitudes_in_words(more)} would bring its U from "
        f"{sizes_told[0]} to {sizes_told[1]} {line.unit}",
    )


def gravity_notes(rests: Rests, estimate: Estimate) -> tuple[str, ...]:
    """Return a note where gravity dominates the U of scale factors: no attitude reduces that part.

    The remaining U is that with gravity computed from latitude and height.
    """
    sensor, gravity = rests.sensor, rests.bench.gravity
    if not gravity.sd > COMPUTED_GRAVITY_SD:
        return ()
    p = len(sensor.coefficients)
    part = _shifts(estimate, "g")[:p] ** 2
    old = estimate.std[:p]
    left = (COMPUTED_GRAVITY_SD / gravity.sd) ** 2
    new = np.sqrt(np.maximum(old**2 - (1 - left) * part, 0.0))
    weak = np.flatnonzero(old > _MIN_IMPROVEMENT * new)
    if not weak.size:
        return ()
    names = [sensor.coefficients[k] for k in weak]
    k = int(weak[np.argmax(new[weak])])
    line = sensor.coefficient(sensor.coefficients[k])
    before, after = (
        format_value_and_uncertainty(0.0, COVERAGE * float(sd[k]) / line.si)[1] for sd in (old, new)
    )
    u = format_value_and_uncertainty(0.0, COVERAGE * gravity.sd)[1]
    return (
        f"gravity, ± {u} m/s², gives most of the U of {', '.join(names)}, which no attitude "
        "reduces: state latitude and height, or measured gravity, in [bench]; with latitude and "
        f"height the U of {sensor.coefficients[k]} falls from {before} to {after} {line.unit}",
    )


def _shifts(estimate: Estimate, name: str) -> Array:
    """Return the shift of each value by one standard deviation of a parameter of the bench."""
    if name not in estimate.names:
        return np.zeros(len(estimate.names))
    column = estimate.covariance[:, estimate.names.index(name)]
    variance = column[estimate.names.index(name)]
    return column / np.sqrt(variance) if variance > 0 else np.zeros(len(column))


def g_sensitivity_findings(rests: Rests, estimate: Estimate) -> tuple[Finding, ...]:
    """Return a finding where the rates at rest follow gravity and the gyros' model has no g term.

    An F test of the rates' residuals against the attitude, at 0.1 %.
    """
    group = next((group for group in estimate.groups if group.name == "rates"), None)
    names = rests.sensor.coefficients
    if group is None or any(name.endswith((".g_i", ".g_p", ".g_o")) for name in names):
        return ()
    p = len(names)
    up = rests.norms(np.concatenate([estimate.value[:p], rests.start()[p:]])).up
    weight = 1 / group.sd.mean(axis=1)[:, None]
    attitude = weight * np.column_stack([np.ones(len(up)), up])
    freedom = 3 * (len(up) - 4)
    if freedom < 1:
        return ()
    alone, with_it = (
        _residual_sum_of_squares(design, weight * group.residual) for design in (weight, attitude)
    )
    ratio = (alone - with_it) / 9 / (with_it / freedom)
    if scipy.special.fdtrc(9, freedom, ratio) > _TEST_LEVEL:
        return ()
    explained = 100 * (1 - with_it / alone)
    text = (
        f"the rates at rest follow gravity ({explained:.0f} % of their scatter): the gyros are "
        "sensitive to acceleration"
    )
    return (Finding("note", "g", text, changes=(Change("method", "also", ("g",)),)),)


def _residual_sum_of_squares(design: Array, y: Array) -> float:
    """Return the residual sum of squares of a linear model."""
    return float(np.sum((y - design @ np.linalg.lstsq(design, y, rcond=None)[0]) ** 2))

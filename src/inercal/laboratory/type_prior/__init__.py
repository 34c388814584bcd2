"""Estimate the prior of a new sensor from calibrations of earlier sensors of its type.

Sensor i has the coefficients θ_i ~ N(μ, T), and its calibration gives c_i = θ_i + e_i with the
covariance of the file. Bench errors that several files share are correlated, so they are neither
scatter between sensors nor do they average out in the mean. Mean and standard deviation of a new
sensor are predicted for each coefficient (`estimation.uncertainty.new_member`). The correlations
come from the REML estimate of T, which is drawn towards uncorrelated coefficients, and from the
covariance of the mean.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName
from inercal.basics.units import format_count
from inercal.calibration import Calibration
from inercal.calibration.comparison import recording_sha256
from inercal.calibration.type_prior import (
    CoefficientPrior,
    OutlyingSensor,
    SourceSensor,
    TypePrior,
    TypeReadout,
)
from inercal.estimation.uncertainty.new_member import (
    NewMember,
    left_out_p_values,
    predict_new_member,
    scatter_correlation,
)
from inercal.laboratory.type_prior.members import (
    Member,
    choose_calibrations,
    common_names,
    find_members,
    joint_covariance,
    require_comparable,
    symmetric_root,
    term_of,
)
from inercal.physics.sensors import SI_UNITS

LEAST_SENSORS = 3
FALSE_ALARMS = 0.01  # probability that any sensor is named although all are of one population


def type_prior(
    calibrations: Sequence[str | Path] | Mapping[str, Calibration],
    coefficients: Sequence[str] = (),
    *,
    without: Sequence[str] = (),
    each_axis: bool = False,
    type_name: str = "",
) -> TypePrior:
    """Return the prior of a new sensor from calibrations of other sensors of its type.

    Parameters
    ----------
    calibrations : sequence of paths, or mapping of str to Calibration
        Calibration files, or calibrations by the name of their source; one for each sensor.
    coefficients : sequence of str
        Names or groups, such as "kip", "ax.k2" or "cross". By default, all coefficients of
        `DEFAULT_GROUPS` that all calibrations have.
    without : sequence of str
        Names of sensors to leave out.
    each_axis : bool
        Whether each axis is a sensor of its own. Calibrations with one axis always are; otherwise
        the prior has one value for each axis.
    type_name : str
        Name of the type, for the file.

    Raises
    ------
    InputError
        There are fewer than three sensors, a sensor occurs twice, the sensors have different
        readouts or forms, or a coefficient is not available.
    """
    chosen = choose_calibrations(calibrations, without)
    members = find_members(chosen, each_axis)
    if len(members) < LEAST_SENSORS:
        raise InputError(
            f"{format_count(len(members), 'sensor')} are too few to estimate how much sensors of a "
            f"type differ; give the calibrations of {LEAST_SENSORS} or more sensors",
            key="FILE",
        )
    names = common_names(members, tuple(coefficients))
    require_comparable(members, names)
    values = np.array([[m.calibration.values[m.places[name]] for name in names] for m in members])
    covariance = joint_covariance(members, names)
    n, p = values.shape
    found = [predict_new_member(values[:, k], covariance[:, k, :, k]) for k in range(p)]
    shared, own = _shared_and_own(covariance)
    measured = np.einsum("nkk->k", own) / n
    correlation, other_axis = _correlations(values, shared, own, found)
    axes = members[0].axes
    used = {CoefficientName(name).axis for name in names}
    return TypePrior(
        type_name=type_name,
        form=members[0].calibration.sensor.form,
        count=n,
        correlations=(
            "Few sensors cannot show correlations between coefficients, so the prior uses about "
            f"{100 * (n - 1) / (n + p):.0f} % of the observed correlations"
        )
        * (p > 1),
        coefficient=tuple(
            CoefficientPrior(
                name=name,
                unit=SI_UNITS[term_of(members[0], name).unit],
                **one._asdict(),
                measurement_share=float(measured[k] / (measured[k] + one.between_sensors**2)),
                correlation=tuple(correlation[k].tolist()),
                other_axis=tuple(other_axis[k].tolist()),
            )
            for k, (name, one) in enumerate(zip(names, found, strict=True))
        ),
        readout=tuple(
            TypeReadout(axis=name, measures=axes[name].measures, **asdict(axes[name].readout))
            for name in axes
            if name in used
        ),
        sensor=tuple(
            SourceSensor(
                name=one.sensor.name, source=source, recording_sha256=recording_sha256(one)
            )
            for source, one in chosen.items()
        ),
        outlying=_outlying_sensors(members, names, values, covariance),
        notes=tuple(
            f"{source} does not state which errors it shares with the other files, so all of its "
            "uncertainty is treated as shared"
            for source, one in chosen.items()
            if one.shared is None
        ),
    )


def _shared_and_own(covariance: Array) -> tuple[Array, Array]:
    """Return the covariance that all sensors share, (p, p), and the rest of each, (n, p, p)."""
    n = len(covariance)
    blocks = np.einsum("ikil->ikl", covariance)
    shared = (covariance.sum(axis=(0, 2)) - blocks.sum(axis=0)) / (n * (n - 1))
    shared = _nonnegative((shared + shared.T) / 2)
    return shared, np.array([_nonnegative(block - shared) for block in blocks])


def _correlations(
    values: Array, shared: Array, own: Array, found: Sequence[NewMember]
) -> tuple[Array, Array]:
    """Return the correlations of a new sensor, with the same axis and with another, (p, p)."""
    scatter = np.array([one.between_sensors for one in found])
    of_scatter, of_mean = scatter_correlation(values, own, scatter)
    of_mean = of_mean + shared
    size = np.sqrt(np.diag(of_mean))
    share = np.sqrt([one.mean_share for one in found])
    rest = np.sqrt(1 - share**2)
    other_axis = of_mean / np.outer(size, size) * np.outer(share, share)
    correlation = of_scatter * np.outer(rest, rest) + other_axis
    np.fill_diagonal(correlation, 1.0)
    return np.clip(correlation, -1, 1), np.clip(other_axis, -1, 1)


def _nonnegative(covariance: Array) -> Array:
    root = symmetric_root(covariance)
    return root @ root


def _outlying_sensors(
    members: Sequence[Member], names: Sequence[str], values: Array, covariance: Array
) -> tuple[OutlyingSensor, ...]:
    """Return the values that the other sensors predict with p < `FALSE_ALARMS` over all tests."""
    n, p = values.shape
    each = FALSE_ALARMS / (n * p)
    outlying: list[OutlyingSensor] = []
    for k, name in enumerate(names):
        chance = left_out_p_values(values[:, k], covariance[:, k, :, k])
        outlying += [
            OutlyingSensor(sensor=members[int(m)].label, coefficient=name, p=float(chance[m]))
            for m in np.flatnonzero(chance < each)
        ]
    return tuple(outlying)

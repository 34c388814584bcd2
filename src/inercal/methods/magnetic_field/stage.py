"""Add the magnetometers to a method that estimates accelerometers and gyros.

The method first estimates accelerometers and gyros as if there were no magnetometers. Then their
estimate, with its covariance, gives the upward directions at the rests and the rotations between
them, and `fit_field` estimates the magnetometers. A disturbed field therefore cannot change the
accelerometers and gyros. The errors of both estimates are correlated: an error ε of the known
coefficients adds C P⁻¹ ε to those of the magnetometers, where C is the cross covariance of the fit
and P the covariance of the known coefficients.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtr  # pyright: ignore[reportMissingTypeStubs]

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName
from inercal.basics.units import Measured, format_number, format_quantity
from inercal.benches import Hand
from inercal.calibration.delays import delay_words
from inercal.calibration.verdict import ALL_SCALES, UNSEEN
from inercal.estimation import Estimate, ResidualGroup, ScoreTestSet
from inercal.estimation.lazy_value import LazyValue
from inercal.estimation.residual_scatter import LEAST_RATIO, LEVEL, ScatterModel
from inercal.estimation.uncertainty import COVERAGE
from inercal.methods import Fit, Remarks, temperature
from inercal.methods.magnetic_field import records
from inercal.methods.magnetic_field.disturbances import field_tests
from inercal.methods.magnetic_field.fitting import FieldFit, fit_field, inhomogeneity_interval
from inercal.methods.residuals import norm_residuals
from inercal.physics.motion import Motion
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding, Observations
from inercal.recordings.magnetic import MagneticReadings

DELAY = "delay"
_FAR_DELAY = 3  # DELAY_SD
STATED_NOISE = "the noise stated in [sensor.magnetometer]"
_OWN = ("dip", "strength")
_ALIKE = 0.25  # relative range of three scale factors that a common cause and soft iron explain
_FAR_SCALE = 0.1  # mean scale-factor error of three axes; usual magnetometers are within 5 %
_HEMISPHERES: dict[int, records.Hemisphere | None] = {1: "north", -1: "south", 0: None}
_UNSEEN = (
    "iron or magnets that turn with the sensor and are absent in use, because they look like hard "
    "and soft iron",
    "a constant disturbance of the field in the room, which only changes its strength and dip",
)
_SCALE_UNSEEN = "a common scale factor of the magnetometers, because no strength is stated"
_CONDITIONS = (
    ("dip", "dip of the field", "°"),
    ("strength", "strength of the field", "µT"),
    (DELAY, "delay of the magnetometers", "ms"),
)


class NodeTimes(NamedTuple):
    """When and where the magnetometers were read: at rests, and in pieces of motion between."""

    time: Array  # (n,), s
    rest: Indices  # (n,), row of the observations; −1 for a piece of motion
    transition: Indices  # (n,), index of the transition of a piece; −1 for a rest


LinkMaker = Callable[[Fit[Hand, Any], NodeTimes], records.Links | None]
DELAY_SD = 0.03  # s, of the magnetometers, before their readings in motion show it


def add_magnetometers(
    fit: Fit[Hand, Any], field: Sensor, links: LinkMaker | None = None
) -> tuple[Estimate, Remarks]:
    """Return the estimate of a fit with the magnetometers added, and remarks on the field.

    Parameters
    ----------
    fit : Fit
        The fit of accelerometers and gyros, whose observations include `magnetic`.
    field : Sensor
        The magnetometers with their coefficients.
    links : callable, optional
        Function that returns the rotations between nodes.

    Raises
    ------
    InputError
        There are no readings, not enough axes, or the axes or the field are not as stated.
    NotObserved
        The attitudes do not determine all coefficients.
    """
    first = _grouped(fit.estimate, fit.observations)
    fit = replace(fit, estimate=first)
    found = _fit(fit, field, links)
    whole, seen = joined(first, found, len(fit.sensor.coefficients)), _readings(fit)
    stated = "[data.sd] magnetometer"
    if seen.noise.any():
        ratio = _stated_variances(fit, seen, field) / np.diagonal(seen.noise)
        stated = STATED_NOISE * bool(np.any(ratio > LEAST_RATIO**2))
    remarks = field_remarks(whole, found, stated)
    late = float(whole.value[whole.names.index(DELAY)]) if DELAY in whole.names else 0.0
    if abs(late) > _FAR_DELAY * DELAY_SD:  # the turn during the delay is no longer a small angle
        cause = delay_words("m", Measured(late, 0.0))
        finding = Finding("warning", "delay", f"{cause}; correct the times", cause=cause)
        remarks = remarks._replace(findings=(*remarks.findings, finding))
    return whole, remarks


def field_remarks(estimate: Estimate, found: FieldFit, stated: str) -> Remarks:
    """Return what no test can detect, with the field and the magnetometers' delay as conditions.

    `stated` names the noise in the run file that exceeds that of the readings; "" if none does. It
    is a finding if the residuals are too small for it.

    Raises
    ------
    InputError
        The fit did not converge.
    """
    if not found.converged:
        raise InputError(
            "the fit of the magnetometers did not converge; check their columns, axes and times",
            key="[data] magnetometer",
        )
    unseen = (*_UNSEEN, *(_SCALE_UNSEEN for _ in range(found.per_field)))
    conditions: dict[str, str] = {}
    for name, what, unit in _CONDITIONS:
        if name in estimate.names:
            k = estimate.names.index(name)
            sd = float(np.sqrt(estimate.covariance[k, k]))
            size = format_quantity(float(estimate.value[k]), COVERAGE * sd, unit)
            conditions[what] = f"{size} (k = {COVERAGE:g})"
    findings = [Finding("note", UNSEEN, text) for text in unseen]
    terms = (CoefficientName(name).term for name in found.names)
    scales = [x for term, x in zip(terms, found.value, strict=True) if term == "scale"]
    if not found.per_field and abs(mean := float(np.mean(scales))) > _FAR_SCALE:
        text = (
            f"the magnetometers read {100 * abs(mean):.0f} % {'more' if mean > 0 else 'less'} than "
            "the stated field; check [bench] field, and unit and scale of [sensor.magnetometer]"
        )
        alike = np.ptp(scales) < _ALIKE * (1 + mean)
        findings.append(Finding("warning", "units", text, cause=ALL_SCALES if alike else ""))
    small = chdtr(found.dof, found.chi2) < LEVEL and found.chi2 > 0
    if stated and small and (ratio := (found.dof / found.chi2) ** 0.5) >= LEAST_RATIO:
        text = (
            f"the residuals of the magnetometers are {format_number(ratio, 2)} times smaller than "
            f"{stated} implies; U is computed from it and is too large"
        )
        findings.append(Finding("warning", "noise", text, factor=ratio))
    return Remarks(tuple(findings), conditions=conditions)


def linear_model(field: Sensor) -> records.LinearModel:
    """Return the model of three magnetometers, whose names are the sensor's coefficients."""
    if len(field.axes) != len("xyz"):
        raise InputError(
            f"sensor {field.name} has {len(field.axes)} magnetometer axes; three are needed, "
            "because one or two do not determine the direction of the field",
            key="[data] magnetometer",
        )
    names, nominal = field.coefficients, np.pad(field.input_axes("m"), ((0, 0), (0, 1)))
    points = np.eye(4)[:, :3]  # three fields of 1 T, and none
    directions = field.design(Motion(0 * points, m=points, dT=1.0), np.zeros(len(names))).T.copy()
    directions[..., :3] -= directions[..., 3:]
    powers = np.array([field.coefficient(n).temperature_order for n in names], dtype=np.int64)
    return records.LinearModel(names, nominal, directions, powers)


def _fit(fit: Fit[Hand, Any], field: Sensor, links: LinkMaker | None) -> FieldFit:
    seen, labels = _readings(fit), fit.observations.labels
    pieces = None if links is None else seen.pieces
    parts = (seen,) if pieces is None else (seen, pieces)
    time, reading, samples = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("time", "mean", "samples")
    )
    order, count = np.argsort(time, kind="stable"), len(seen.rest)
    more, rests = np.full(len(time) - count, -1), np.full(count, -1)
    transition = rests if pieces is None else np.concatenate([rests, pieces.transition])
    at = NodeTimes(time[order], np.concatenate([seen.rest, more])[order], transition[order])
    covariance = np.concatenate([seen.covariance, seen.noise / samples[count:, None, None]])
    # At least as large as the stated noise implies.
    stated = _stated_variances(fit, seen, field) / samples[:, None]
    lacking = stated - np.linalg.diagonal(covariance)
    covariance += np.maximum(lacking, 0.0)[:, :, None] * np.eye(len("xyz"))
    rows: list[int] = at.rest.tolist()
    moments: list[float] = at.time.tolist()
    places = zip(rows, moments, strict=True)
    warmth = [temperature_offsets(part.temperature, field, len(part.time)) for part in parts]
    nodes = records.FieldNodes(
        tuple(labels[row] if row >= 0 else f"{t:.2f} s" for row, t in places),
        reading[order],
        covariance[order],
        at.time,
        np.concatenate(warmth)[order],
    )
    p, delayed = len(fit.sensor.coefficients), int(more.size > 0)
    known = np.zeros((p + delayed, p + delayed))
    known[:p, :p] = fit.estimate.covariance[:p, :p]
    known[p:, p:] = DELAY_SD**2
    return fit_field(
        nodes,
        linear_model(field),
        _directions(fit, at.rest, p + delayed),
        None if links is None else links(fit, at),
        records.FieldConditions(fit.bench.field, fit.bench.dip, _HEMISPHERES[fit.bench.dip_sign]),
        known,
    )


def _stated_variances(fit: Fit[Hand, Any], seen: MagneticReadings, field: Sensor) -> Array:
    """Return the variance of one value of each axis by the stated white noise and rounding."""
    rate = float(np.median(seen.samples / fit.observations.duration[seen.rest]))
    noises = [axis.noise for axis in field.axes]
    return np.array([noise.white**2 * rate + noise.quantisation**2 / 12 for noise in noises])


def temperature_offsets(kelvin: Array | None, field: Sensor, count: int) -> Array:
    """Return ΔT of each reading, (count,) K; zeros if the sensor does not depend on it.

    Raises
    ------
    InputError
        The sensor has temperature coefficients, but no temperature was recorded.
    """
    if not field.uses("dT"):
        return np.zeros(count)
    if kelvin is None:
        raise InputError(
            "coefficients of the magnetometers depend on the temperature, but the recording has no "
            "temperature; name the column of the temperature, or leave out these coefficients",
            key="[data] temperature",
        )
    return kelvin - field.reference_temperature


def _readings(fit: Fit[Hand, Any]) -> MagneticReadings:
    if fit.observations.magnetic is None:
        raise InputError(
            "the data have no readings of the magnetometers; name their columns",
            key="[data] magnetometer",
        )
    return fit.observations.magnetic


def _directions(fit: Fit[Hand, Any], rest: Indices, known: int) -> records.Directions:
    """Return the upward directions at the rests, with the derivatives by all known coefficients."""
    observations, first = fit.observations, fit.estimate
    force = fit.sensor.select_axes("f")
    if force.rank("f") < len("xyz"):
        raise InputError(
            "magnetometers need three accelerometers, which give the upward direction at each rest",
            key="[sensor.accelerometer]",
        )
    a, m = len(force.coefficients), len(force.axes)
    warmth = temperature.row_offsets(observations, force)
    gravity = np.array([fit.bench.gravity.value])
    at = norm_residuals(force, observations.mean[:, :m], first.value[:a], gravity, dT=warmth)
    length = np.linalg.norm(at.specific_force, axis=-1)
    across = (np.eye(3) - at.up[:, :, None] * at.up[:, None, :]) / length[:, None, None]
    derivative = np.zeros((len(length), 3, known))
    derivative[..., :a] = across @ at.by_coefficient
    scatter = next((g.spread for g in first.groups if g.name == "norms"), ScatterModel())
    back = np.linalg.pinv(force.input_axes("f"))
    noise = back @ scatter.of(observations.covariance[:, :m, :m]) @ back.T
    covariance = noise / length[:, None, None] ** 2
    node = np.flatnonzero(rest >= 0)
    row = rest[node]
    return records.Directions(node, at.up[row], covariance[row], derivative[row])


def _grouped(first: Estimate, observations: Observations) -> Estimate:
    """Return an estimate whose readings are a group, because each group has its own χ² test."""
    if first.groups:
        return first
    rows = len(observations.labels)
    residual = first.residual[: observations.mean.size].reshape(rows, -1)[:, : len("xyz")]
    deviation = np.sqrt(np.linalg.diagonal(observations.covariance))[:, : len("xyz")]
    birge = float(first.birge)
    group = ResidualGroup(
        "readings",
        "m/s²",
        observations.labels,
        residual,
        deviation,
        float(first.chi2),
        first.dof,
        ScatterModel(excess=float(np.sqrt((birge**2 - 1) * np.mean(deviation**2)))),
        enlarged=birge > 1,
    )
    return replace(first, covariance=first.stated_covariance, groups=(group,))


def joined(first: Estimate, found: FieldFit, p: int) -> Estimate:
    """Return both estimates as one; the first `p` parameters of `first` are the coefficients."""
    q, own = len(first.names), len(found.names) - sum(name in found.names for name in _OWN)
    known = first.covariance[:p, :p]
    size = np.sqrt(np.diagonal(known))
    size = np.where(size > 0, size, 1.0)
    # The delay, if there is one, is the last of the known coefficients of the field's fit.
    d = len(found.correction) - p
    below = np.block(
        [
            [found.covariance, found.cross[:, p:]],
            [found.cross[:, p:].T, found.known_covariance[p:, p:]],
        ]
    )
    with_known = np.concatenate([found.cross[:, :p], found.known_covariance[p:, :p]])
    gain = with_known / size @ np.linalg.pinv(known / np.outer(size, size)) / size
    cross = gain @ first.covariance[:p]
    joint = np.block([[first.covariance, cross.T], [cross, below]])
    # Coefficients come first, then the quantities of the bench and of the field.
    order = [*range(p), *range(q, q + own), *range(p, q), *range(q + own, len(joint))]
    names = (*first.names, *found.names, *(DELAY,) * d)
    value = np.concatenate([first.value, found.value, found.correction[p:]])
    wanted = tuple(names[k] for k in order[: p + own])
    chi2 = first.chi2 + found.chi2
    return replace(
        first,
        names=tuple(names[k] for k in order),
        value=value[order],
        covariance=joint[np.ix_(order, order)],
        chi2=chi2,
        dof=first.dof + found.dof,
        wanted=wanted,
        rank=first.rank + own,
        singular_values=np.sort(np.concatenate([first.singular_values, found.singular_values]))[
            ::-1
        ],
        converged=first.converged & found.converged,
        groups=(*first.groups, _field_group(found)),
        notes=(*first.notes, *found.notes, *_inhomogeneity_note(found)),
        scoring=LazyValue(lambda: _joined_tests(first.score_tests, found, p, own, len(order))),
        sensitivities={
            name: np.concatenate([by, gain @ by[:p]])[order]
            for name, by in first.sensitivities.items()
        },
    )


def _field_group(found: FieldFit) -> ResidualGroup:
    """Return the readings of the magnetometers as a group with its own χ²."""
    nodes = found.plain.problem.nodes
    deviation = np.sqrt(np.linalg.diagonal(nodes.covariance))
    return ResidualGroup(
        "magnetic field",
        "T",
        nodes.labels,
        found.plain.rows.reading.residual * deviation,
        deviation,
        found.chi2,
        found.dof,
        ScatterModel(excess=found.inhomogeneity * float(found.value[-1])),
    )


def _inhomogeneity_note(found: FieldFit) -> tuple[str, ...]:
    """Return a sentence on the inhomogeneity of the field, if there is any."""
    if not found.inhomogeneity:
        return ()
    low, high = inhomogeneity_interval(found)
    where = "rests" if len(found.plain.problem.directions.node) else "samples"
    tau, low, high = (format_number(100 * one, 2) for one in (found.inhomogeneity, low, high))
    return (
        f"The field differs between the {where} by {tau} % in each component (95 % interval "
        f"{low} to {high} %), which the uncertainties include.",
    )


def _tests_of_field(found: FieldFit, first: int, count: int) -> ScoreTestSet:
    """Return the tests of a fit, with shifts of `count` values; its own begin at `first`."""
    free = found.plain.problem.free
    own = np.flatnonzero(free < len(found.plain.problem.model.names))

    def shift(by: Array) -> Array:
        whole = np.zeros(count)
        whole[first + free[own]] = by[own]
        return whole

    return field_tests(found).with_shifts(shift)


def _joined_tests(one: ScoreTestSet, found: FieldFit, p: int, own: int, count: int) -> ScoreTestSet:
    """Return the score tests of both fits; those of one do not explain residuals of the other."""
    other = _tests_of_field(found, p, count)
    rows = 1 + max((int(s.explained.indices.max(initial=0)) for s in one.scores), default=0)
    depth, more = (
        max((s.explained.projection.size for s in part.scores), default=0) for part in (one, other)
    )
    first = one.with_shifts(
        lambda by: np.concatenate([by[:p], np.zeros(own), by[p:], np.zeros(count)])[:count]
    )
    scores = [
        replace(
            s,
            explained=replace(
                s.explained,
                indices=s.explained.indices + below,
                projection=np.pad(s.explained.projection, pad),
            ),
        )
        for part, below, pad in ((first, 0, (0, more)), (other, rows, (depth, 0)))
        for s in part.scores
    ]
    return replace(
        one,
        scores=tuple(scores),
        span=one.span + other.span,
        chi2=one.chi2 + other.chi2,
        dof=one.dof + other.dof,
    )

"""List what the order of six positions may hide from the readings, and how to detect it.

A bias may change in a step between two positions. A sensor with hysteresis retains a part of its
previous input, or has an error with the sign of the last change of its input. Each effect is a
pattern of the readings in time order::

    step after row j         1 in all later rows
    input before             u_{i−1}, the input of the axis in the row before, in g
    sense of the change      sign(u_i − u_{i−1}), as before where the input did not change

A vibration that the sensor rectifies, or that is aliased to a constant, adds the same amount in all
rows. The part of a pattern that the coefficients and bench errors absorb leaves no residual. A
pattern is reported if a size that shifts a coefficient by 5 u leaves residuals with a norm below 7.
The report states this size (`inercal.calibration.detectability`).

Some estimators have no meaningful residuals of their own; maximum likelihood tests them. A closed
formula uses only some of the readings, or all of them with equal weights, so its residuals test
nothing. The maximum-likelihood problem with the same observations and the stated bench gives a χ²
and score tests of the readings, whichever formula is used.

The formula itself is tested by its difference d from maximum likelihood. If both are valid, the
maximum-likelihood estimate is efficient. For any other estimate with covariance C (Hausman 1978,
Econometrica 46, 1251–1271)::

    cov(d) = C − C_ml        T = dᵀ (C − C_ml + ε C)⁻¹ d

T is at most a χ² variable with one degree of freedom per coefficient. The term with ε adds a tenth
of the formula's standard uncertainty, because C − C_ml is only rounding if the formula is as good
as maximum likelihood.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, NotObserved
from inercal.basics.units import format_value_and_uncertainty
from inercal.benches import Hand
from inercal.benches.hand.bench import visit_number
from inercal.calibration.detectability import CRITICAL_SHIFT, DETECTABLE_NORM
from inercal.estimation import (
    Estimate,
    ModelTest,
    Problem,
    ScoreTestSet,
    least_squares,
    score_tests,
)
from inercal.estimation.candidate_scores import rows_from_products
from inercal.estimation.lazy_value import LazyValue
from inercal.methods import Fit, Priors, Remarks
from inercal.methods.candidates import prior_candidates
from inercal.methods.observability import NOISE_ONLY_NOTE
from inercal.physics.plan import Hold, Turn
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import Axis, Sensor
from inercal.physics.sensors.coefficient_tables import TERMS, ErrorTerm
from inercal.recordings import Finding

READINGS_TEST = "readings against the bench as stated"
FORMULA_TEST = "estimator against maximum likelihood"
_REGULARISATION = 0.01  # ε


def noise_only_estimate(sensor: Sensor, value: Array, spread: Array) -> Estimate:
    """Return the result of closed formulas, (p,) with covariance (p, p), for an exact bench."""
    information = np.linalg.inv(spread / np.outer(sensor.unit_scale, sensor.unit_scale))
    singular = np.sqrt(np.linalg.eigvalsh(information)[::-1])
    return Estimate.from_closed_form(
        sensor.coefficients, value, spread, singular, (NOISE_ONLY_NOTE,)
    )


def with_problem_tests(found: Estimate, by_problem: Estimate) -> Estimate:
    """Return a noise-only estimate with the tests of a problem that has the same observations."""
    p = len(found.names)
    agreement = ModelTest(READINGS_TEST, float(by_problem.chi2), by_problem.dof)
    return replace(
        found,
        tests=(agreement, *by_problem.tests),
        scoring=by_problem.scoring.then(lambda one: one.with_shifts(lambda shift: shift[:p])),
        rows=by_problem.rows,
        notes=(*found.notes, *by_problem.notes),
    )


def with_tests(estimate: Estimate, whole: Problem, stated: Problem | None = None) -> Estimate:
    """Return an estimate with tests of its observations and of its formula.

    Parameters
    ----------
    estimate : Estimate
        Estimate from one recording. An estimate from many trials or without uncertainty is returned
        unchanged, and so is any estimate for which maximum likelihood fails.
    whole : Problem
        The maximum-likelihood problem with all stated errors of the bench.
    stated : Problem, optional
        The same problem, with only the errors that the estimate's covariance includes, if it
        includes fewer.
    """
    if estimate.value.ndim != 1 or not np.isfinite(estimate.covariance).all():
        return estimate
    try:
        best = least_squares(whole)
        reference = best if stated is None else least_squares(stated)
    except (NotObserved, InputError):
        return estimate
    if not (best.converged and reference.converged):
        return estimate
    tests = [ModelTest(READINGS_TEST, float(best.chi2), best.dof)] if best.dof else []
    at = [best.names.index(name) for name in estimate.names]
    formula = _hausman_test(estimate, reference.select(estimate.names))
    return replace(
        estimate,
        tests=(*estimate.tests, *tests, formula),
        scoring=best.scoring.then(lambda one: one.with_shifts(lambda shift: shift[at])),
        rows=best.rows,
    )


def _hausman_test(estimate: Estimate, best: Estimate) -> ModelTest:
    """Test the difference between an estimate and the maximum-likelihood estimate."""
    sd = np.sqrt(np.diagonal(estimate.covariance))
    between = (estimate.covariance - best.covariance) / np.outer(sd, sd)
    size, axes = np.linalg.eigh(between)
    away = axes.T @ ((estimate.value - best.value) / sd)
    own = np.einsum("ik,ij,jk->k", axes, estimate.covariance / np.outer(sd, sd), axes)
    statistic = float(np.sum(away**2 / (np.maximum(size, 0.0) + _REGULARISATION * own)))
    return ModelTest(FORMULA_TEST, statistic, len(sd))


_REPEATED = "repeat a position of each axis at the end to detect it"
_REVERSED = "take the positions again in the reverse order to detect it"
_BOTH_SENSES = "reach attitudes between the positions from both sides to detect it"
_TURNS = "error of the angles that all turns have in common: it is a scale error of the gyros"
_STILL = "make a second recording without vibration to detect it"


class _Pattern(NamedTuple):
    """A pattern of the readings: its name, how to detect it, and the effect on each row."""

    name: str
    remedy: str
    axis: str
    by_row: Array  # (r,) per unit of its size


def order_remarks(fit: Fit[Hand, Any]) -> Remarks:
    """Return a finding on each order effect that these positions cannot reveal.

    The message begins with the effect's name and says how to detect it. `channel` is the axis with
    the smallest size that shifts a coefficient by 5 u.
    """
    rows, estimate, sensor = fit.estimate.rows(), fit.estimate, fit.sensor
    if rows is None or len(estimate.observations or rows.residual) != len(rows.residual):
        return Remarks()
    channels, r = sensor.channels, len(fit.steps)
    if r * len(channels) != len(rows.residual):
        return Remarks()
    order = np.argsort(fit.observations.time, kind="stable").tolist()
    remedy = _REVERSED if _has_reverse_order(fit, order) else _BOTH_SENSES
    patterns, change = _patterns(tuple(fit.steps), sensor.axes, tuple(order), remedy)
    if not patterns:
        return Remarks()
    shift, visibility = rows.effects(change)
    u = estimate.std[: len(sensor.coefficients)]
    moved = np.max(np.abs(shift[: u.size]) / np.where(u > 0, u, np.inf)[:, None], axis=0)
    unseen: dict[str, tuple[_Pattern, float]] = {}
    for one, most, norm in zip(patterns, moved.tolist(), visibility.tolist(), strict=True):
        if DETECTABLE_NORM * most <= CRITICAL_SHIFT * norm:
            continue
        size = CRITICAL_SHIFT / most
        if size > _bias(sensor, one).largest:  # effects on rows of turns shift no coefficient
            continue
        if one.name not in unseen or size < unseen[one.name][1]:
            unseen[one.name] = one, size
    findings = tuple(
        Finding("note", "unseen", f"{name}: {_size_text(sensor, *unseen[name])}; "
                f"{unseen[name][0].remedy}", unseen[name][0].axis)
        for name in dict.fromkeys(one.name for one in patterns)
        if name in unseen
    )  # fmt: skip
    gyros = sensor.select_axes("w").axes and any(isinstance(step, Turn) for step in fit.steps)
    if gyros and fit.bench.turn_angle:  # an exact angle is named as a bench parameter
        findings += (Finding("note", "unseen", _TURNS),)
    return Remarks(findings=findings)


@lru_cache
def _patterns(
    steps: tuple[Any, ...], axes: tuple[Axis, ...], order: tuple[int, ...], of_senses: str
) -> tuple[list[_Pattern], Array]:
    """Return the patterns of each axis, and their effect on all readings, (r m, patterns).

    `order` lists the rows in time order; `of_senses` is the remedy for the sense of the change.
    """
    found: list[_Pattern] = []
    r, m = len(steps), len(axes)
    later = np.argsort(order)
    for axis in axes:
        kind = QUANTITIES[axis.measures].sensors
        for j in range(r - 1):
            name = f"step of the {kind} between two positions"
            found.append(_Pattern(name, _REPEATED, axis.name, np.where(later > j, 1.0, 0.0)))
        name = f"vibration rectification of the {kind}"
        found.append(_Pattern(name, _STILL, axis.name, np.ones(r)))
        if axis.measures != "f":
            continue
        inputs, senses = _inputs_and_senses(steps, np.array(axis.i), order)
        for by_row, remedy in ((inputs, _REVERSED), (senses, of_senses)):
            found.append(_Pattern(f"hysteresis of the {kind}", remedy, axis.name, by_row))
    names, change = [axis.name for axis in axes], np.zeros((r, m, len(found)))
    for k, one in enumerate(found):
        change[:, names.index(one.axis), k] = one.by_row
    return found, change.reshape(r * m, len(found))


def _has_reverse_order(fit: Fit[Hand, Any], order: Sequence[int]) -> bool:
    """Return whether at least half of the positions were visited again."""
    labels = [fit.observations.labels[k] for k in order if isinstance(fit.steps[k], Hold)]
    return 2 * sum(visit_number(label) > 1 for label in labels) >= len(labels) > 0


def _inputs_and_senses(
    steps: Sequence[Any], axis: Array, order: Sequence[int]
) -> tuple[Array, Array]:
    """Return an axis's previous input, g, and its direction of change, for each row.

    The direction is the sign of the input's last change, −1, 0 or 1. Turns change neither value.
    """
    inputs, senses = np.zeros(len(steps)), np.zeros(len(steps))
    before = reached = sense = 0.0
    for k in order:
        inputs[k] = before
        if not isinstance(steps[k], Turn):
            before = float(axis @ steps[k].up)
            if abs(before - reached) > 1e-6:
                reached, sense = before, float(np.sign(before - reached))
        senses[k] = sense
    return inputs, senses


def _bias(sensor: Sensor, one: _Pattern) -> ErrorTerm:
    """Return the table entry for the bias of a pattern's axis."""
    measures = sensor.measures[one.axis]
    return TERMS[measures][QUANTITIES[measures].bias]


def _size_text(sensor: Sensor, one: _Pattern, size: float) -> str:
    """Return a size in the unit of the axis's bias."""
    line = _bias(sensor, one)
    return f"{format_value_and_uncertainty(0.0, size / line.si)[1]} {line.unit}"


# Share of a prior's information; with less from the data, rounding would decide a test of the prior
_LEAST_INFORMATION = 1e-6


def with_tests_of_priors(estimate: Estimate, sensor: Sensor, priors: Priors) -> Estimate:
    """Return an estimate that has no score tests, such as from a filter, with those of priors.

    With the prior N(μ, S), and the estimate x̂ with covariance P, the products of
    `rows_from_products` are S⁻¹ − S⁻¹ P S⁻¹ and S⁻¹ (x̂ − μ). A prior that is wrong by δ shifts
    the estimate by −P S⁻¹ δ.
    """
    if not priors:
        return estimate
    roots, targets = zip(*(prior.rows(estimate.names) for prior in priors), strict=True)
    root = np.concatenate(roots)
    inverse, moved = root.T @ root, estimate.covariance @ root.T @ root
    gram = inverse - inverse @ moved
    decided = np.diagonal(gram) < _LEAST_INFORMATION * np.diagonal(inverse)  # by the priors
    gram[decided], gram[:, decided] = 0.0, 0.0
    product = root.T @ (root @ estimate.value - np.concatenate(targets))
    residual, rows = rows_from_products(gram, np.where(decided, 0.0, product))
    column = dict(zip(estimate.names, rows.T, strict=True))
    found = [
        replace(one, moved=moved @ one.moved)
        for one in prior_candidates(sensor, estimate.names, priors, column)
        if one.moved is not None
    ]

    def tested() -> ScoreTestSet:
        scores = score_tests(residual, np.zeros((len(residual), 0)), found)
        return replace(scores, chi2=float(estimate.chi2), dof=estimate.dof)

    return replace(estimate, scoring=LazyValue(tested))

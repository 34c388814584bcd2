"""Find rows of a table that violate the norm, and the single change that would repair each row.

A table that was typed by hand or copied from print may have lost signs, exchanged columns and wrong
digits. The norm reveals these errors without a reference. All rows are fitted with Cauchy's loss,
and its threshold is halved step by step from the largest residual down to the noise (graduated
non-convexity: Blake and Zisserman 1987, Visual Reconstruction, chapter 7). The rows that agree with
each other therefore decide the fit. A fixed threshold would fail, because wrong rows distort the
fit and give good rows large residuals.

Each suspect row is tried with one change at a time: the sign of an entry, two exchanged entries,
the decimal point of an entry shifted by one place, then one digit of an entry or two neighbouring
digits exchanged. The first kind of change that brings the row within its noise is named. No change
is applied, because only the user has the original table.

A row is suspect if its residual is too large to be explained by chance as the largest residual of
all rows. The score test of a single row in `inercal.methods.candidates` has the same significance
level.
"""
# SciPy has no type stubs.
# pyright: reportMissingTypeStubs=false

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError
from inercal.benches.centrifuge.bench import Centrifuge
from inercal.benches.contradicting_rows import Repair, single_changes
from inercal.estimation import Cauchy, Estimate, Problem, least_squares
from inercal.estimation.scores import SIGNIFICANCE_LEVEL
from inercal.methods import Priors
from inercal.methods.centrifuge_norm.problems import norm_problem
from inercal.methods.solving import require_single_recording
from inercal.physics.plan import Spins
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations

_FINAL_THRESHOLD = 1.5  # threshold of the loss at the end, in standard deviations
_FINAL_ITERATIONS, _INTERMEDIATE_ITERATIONS = 30, 5  # at the last threshold and at earlier ones
_THRESHOLD_TOLERANCE = 1e-8  # relative; moves the fit by far less than its uncertainty
# For the fit before any threshold, because a table that is wrong as a whole never converges.
START_ITERATIONS = 50
_REPAIR_LIMIT = 4.0  # standard deviations; and at most half of the residual without the repair
_MAX_LISTED_REPAIRS = 4  # per row
_INCONSISTENT_SCATTER = 1e3  # times the stated noise
_MAD_FACTOR = 1.4826  # standard deviation per median of |u|


@dataclass(frozen=True)
class SuspectRow:
    """A row that violates the norm.

    Parameters
    ----------
    label : str
    row : int
    residual : float
        The bench's norm minus the norm of the reading, m/s².
    deviations : float
        The residual divided by its standard deviation.
    repairs : tuple of Repair
        All single changes of the simplest kind that bring the row within its noise; empty if there
        are none.
    """

    label: str
    row: int
    residual: float
    deviations: float
    repairs: tuple[Repair, ...]

    def describe(self) -> str:
        """Return a description of the row, the error of its norm, and the repairs."""
        text = f"{self.label}: the norm is off by {abs(self.residual):.3g} m/s²"
        if not self.repairs:
            return f"{text}; no single change corrects it"
        if len(self.repairs) > _MAX_LISTED_REPAIRS:
            kind = self.repairs[0].kind.replace("decimal", "decimal point")
            return f"{text}; {len(self.repairs)} changes of a single {kind} would correct it"
        repairs = " or ".join(repair.describe() for repair in self.repairs)
        return f"{text}; {repairs} would correct it"


def screen_rows(
    observations: Observations,
    sensor: Sensor,
    bench: Centrifuge,
    steps: Spins,
    priors: Priors = (),
    agreement: "Agreement | None" = None,
) -> tuple[SuspectRow, ...]:
    """Return the rows that violate the norm, in the order of the table.

    Parameters
    ----------
    observations, sensor, bench, steps, priors
        The same as for `inercal.methods.centrifuge_norm.ml`.
    agreement : Agreement, optional
        Agreement between these rows, if already computed.

    Raises
    ------
    InputError
        There are many trials, or fewer than half of the rows agree with each other.
    NotObserved
        These dwells do not determine all coefficients.
    """
    require_single_recording(observations, "the screening of rows")
    agreement = agreement or row_agreement(norm_problem(observations, sensor, bench, steps, priors))
    fit, noise = agreement.fit, agreement.noise
    bad: list[int] = agreement.outlier_rows.tolist()
    if agreement.inconsistent:
        named = f" ({observations.labels[bad[0]]})" if len(bad) == 1 else ""
        raise InputError(
            f"{len(bad)} of {len(steps)} rows are outliers{named}, and the norms of the others "
            f"scatter {noise:.3g} times as much as stated; check the rates, the radius and the "
            "nominal scale before you check individual rows, and whether the accelerometers have "
            'lever arms ([data] attitude with [method] also = ["arm_i"] estimates them)',
            names=tuple(observations.labels[k] for k in bad),
        )

    warmth = observations.temperature

    def deviations(rows: Array, k: int) -> Array:
        """Return the norm errors in standard deviations, (v,), of variants of row k, (v, m) SI."""
        variants = replace(
            observations,
            labels=tuple(str(j) for j in range(len(rows))),
            mean=rows,
            covariance=np.repeat(observations.covariance[k : k + 1], len(rows), axis=0),
            duration=np.ones(len(rows)),
            samples=np.ones(len(rows), dtype=np.int64),
            time=np.zeros(len(rows)),
            drift=None,
            rounding=None,
            temperature=None if warmth is None else np.full(len(rows), warmth[k]),
        )
        one = _with_independent_rows(
            norm_problem(variants, sensor, bench, [steps[k]] * len(rows), priors)
        )
        value, covariance = _parameters_of_row(fit, one)
        residual, jacobian = one.linearise(value)
        assert callable(one.noise)
        own = noise * one.noise(value)
        spread = np.einsum("vi,ij,vj->v", jacobian, noise**2 * covariance, jacobian)
        return np.abs(residual) / np.sqrt(own**2 + spread)

    suspects: list[SuspectRow] = []
    for k in bad:
        written, z = sensor.to_output(observations.mean[k]), float(fit.whitened[k]) / noise
        repairs: tuple[Repair, ...] = ()
        for changes in single_changes(written, sensor.channels):
            after = np.tile(written, (len(changes), 1))
            for row, change in zip(after, changes, strict=True):
                for axis, value in change.after.items():
                    row[sensor.channels.index(axis)] = value
            near = deviations(sensor.to_si(after), k) < min(_REPAIR_LIMIT, abs(z) / 2)
            repairs = tuple(c for c, good in zip(changes, near.tolist(), strict=True) if good)
            if repairs:
                break
        suspects.append(SuspectRow(observations.labels[k], k, float(fit.residual[k]), z, repairs))
    return tuple(suspects)


class Agreement(NamedTuple):
    """The agreement between rows: a robust fit, and the scatter of the rows about it."""

    fit: Estimate
    noise: float  # ratio of the scatter of most rows to the stated one, at least 1
    outlier_rows: Indices  # rows whose residual is larger than chance explains

    @property
    def inconsistent(self) -> bool:
        """Whether the rows do not agree with any norm."""
        return self.noise > _INCONSISTENT_SCATTER or 2 * len(self.outlier_rows) >= len(
            self.fit.whitened
        )


def row_agreement(problem: Problem) -> Agreement:
    """Return how well the rows of a norm problem agree; a bad row does not affect the others."""
    problem = replace(_with_independent_rows(problem), candidates=None)
    fit = least_squares(problem, max_iterations=START_ITERATIONS)
    scale = float(np.abs(fit.whitened).max())
    noise = 1.0
    while scale > (1 + _THRESHOLD_TOLERANCE) * _FINAL_THRESHOLD * noise:
        last = scale / 2 <= _FINAL_THRESHOLD * noise
        scale = max(scale / 2, _FINAL_THRESHOLD * noise)
        steps = _FINAL_ITERATIONS if last else _INTERMEDIATE_ITERATIONS
        fit = least_squares(replace(problem, start=fit.value), Cauchy(scale), steps)
        # If the stated noise is too small, not every row is a suspect.
        noise = max(1.0, _MAD_FACTOR * float(np.median(np.abs(fit.whitened))))
    # Half of the level, because residuals of both signs are tested.
    limit = -float(scipy.special.ndtri(SIGNIFICANCE_LEVEL / 4 / len(fit.whitened)))
    return Agreement(fit, noise, np.flatnonzero(np.abs(fit.whitened) > limit * noise))


def _parameters_of_row(fit: Estimate, problem: Problem) -> tuple[Array, Array]:
    """Return the parameters that act on a row, and their covariance, from a fit to other rows.

    Bench errors that belong only to this row keep their priors.
    """
    place = {name: k for k, name in enumerate(fit.names)}
    value = np.atleast_2d(problem.start)[0].copy()
    covariance = np.zeros((value.size, value.size))
    for prior in problem.priors:
        at = [problem.names.index(name) for name in prior.names]
        covariance[np.ix_(at, at)] += prior.covariance
    seen = [k for k, name in enumerate(problem.names) if name in place]
    of_fit = [place[problem.names[k]] for k in seen]
    value[seen] = fit.value[of_fit]
    covariance[seen] = covariance[:, seen] = 0.0
    covariance[np.ix_(seen, seen)] = fit.covariance[np.ix_(of_fit, of_fit)]
    return value, covariance


def _with_independent_rows(problem: Problem) -> Problem:
    """Return the problem with uncorrelated rows, so that a bad row does not affect other rows."""
    stated = problem.noise
    assert callable(stated)

    def noise(x: Array) -> Array:
        return np.sqrt(np.linalg.diagonal(stated(x)))

    return replace(problem, noise=noise, correlated=False) if problem.correlated else problem

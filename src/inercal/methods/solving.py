"""Parts that estimators share: checks of their inputs, and least squares for all trials."""

from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from itertools import zip_longest
from typing import Any

import numpy as np

from inercal.basics.errors import InputError
from inercal.estimation import Estimate, Gaussian, Problem, least_squares, least_squares_of_trials
from inercal.estimation.fitting import least_squares_each
from inercal.methods import Priors
from inercal.methods.temperature import temperature_coefficients
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations


def require_matching_rows(observations: Observations, sensor: Sensor, steps: Sequence[Any]) -> None:
    """Raise InputError if the steps or channels do not match the rows.

    Raises
    ------
    InputError
        The channels do not match, a row does not match its step, or two steps have the same label.
    """
    if observations.channels != sensor.channels:
        raise InputError(
            f"the readings are from {', '.join(observations.channels)}, but the sensor has "
            f"{', '.join(sensor.channels)}; give the readings of the sensor's axes in the same "
            "order",
            key="observations",
            names=observations.channels,
        )
    labels = tuple(step.label for step in steps)
    if again := tuple(sorted({label for label in labels if labels.count(label) > 1})):
        raise InputError(
            f"two steps have the label {again[0]!r}; give each step a different label",
            key="steps",
            names=again,
        )
    if labels != observations.labels:
        pairs = zip_longest(observations.labels, labels)
        row, step = next(pair for pair in pairs if pair[0] != pair[1])
        raise InputError(
            f"the steps do not match the observations, which have {row or 'no row'} where the "
            f"steps have {step or 'no step'}; give one step per row, in the order of the rows",
            key="steps",
            names=tuple(label for label in (row, step) if label is not None),
        )


def require_single_recording(observations: Observations, what: str) -> None:
    """Raise InputError if there are many trials; `what` names the caller: "estimator fourier".

    Raises
    ------
    InputError
    """
    if observations.mean.ndim != 2:
        raise InputError(
            f"{what} needs a single recording, not {observations.mean.shape[0]} trials; pass "
            "one trial",
            key="observations",
        )


def refuse_priors(priors: Priors, estimator: str, instead: str) -> None:
    """Raise InputError if there are priors and the estimator cannot use them.

    Parameters
    ----------
    priors : sequence of Gaussian
    estimator, instead : str
        Names of this estimator, and of an estimator that uses priors.

    Raises
    ------
    InputError
        There are priors; the message names their coefficients.
    """
    if names := tuple(name for prior in priors for name in prior.names):
        raise InputError(
            f"estimator {estimator} does not use priors; remove the priors, or use estimator "
            f"{instead}",
            key="priors",
            names=names,
        )


def refuse_temperature_terms(sensor: Sensor, estimator: str, instead: str) -> None:
    """Raise InputError if there are temperature coefficients that the estimator cannot estimate.

    Parameters
    ----------
    sensor : Sensor
    estimator, instead : str
        Names of this estimator, and of an estimator that can estimate them.

    Raises
    ------
    InputError
        There are temperature coefficients; the message names them.
    """
    if names := tuple(temperature_coefficients(sensor)):
        raise InputError(
            f"estimator {estimator} cannot estimate temperature coefficients "
            f"({', '.join(names)}); use estimator {instead}, or leave them out",
            key="[method]",
            names=names,
        )


def refuse_tilted_form(sensor: Sensor, estimator: str, instead: str) -> None:
    """Raise InputError if the sensor is not in the reference form, which formulas need.

    Raises
    ------
    InputError
    """
    if sensor.form != "reference":
        raise InputError(
            f"estimator {estimator} estimates only the reference form; set [sensor] form = "
            f'"reference", or use estimator {instead}',
            key="[sensor] form",
        )


def require_plain_means(
    observations: Observations, sensor: Sensor, priors: Priors, estimator: str
) -> None:
    """Raise InputError for inputs that formulas cannot use.

    Such inputs are priors, temperature coefficients and many trials.

    Raises
    ------
    InputError
    """
    refuse_priors(priors, estimator, "ml")
    refuse_temperature_terms(sensor, estimator, "ml")
    require_single_recording(observations, f"estimator {estimator}")


_prepared: ContextVar[list[Estimate] | None] = ContextVar("prepared", default=None)
_each: ContextVar[list[Estimate | None] | None] = ContextVar("each", default=None)


class _EachFoundError(Exception):
    """The estimates were found, so the estimator of the trials need not continue."""


@contextmanager
def prepared(estimate: Estimate | None) -> Generator[None]:
    """Let the first call of `solve` in this block return an estimate that `solve_each` found."""
    token = _prepared.set([] if estimate is None else [estimate])
    try:
        yield
    finally:
        _prepared.reset(token)


def solve_each(estimate: Callable[[], Estimate]) -> list[Estimate | None]:
    """Return the estimates of single recordings from an estimator of their trials.

    Parameters
    ----------
    estimate : callable
        Function that calls `solve` with observations of a few trials.

    Returns
    -------
    list of Estimate or None
        See `inercal.estimation.fitting.least_squares_each`; empty if the estimator cannot be used
        for trials.
    """
    found: list[Estimate | None] = []
    token = _each.set(found)
    try:
        with suppress(Exception):  # any: each recording is then solved alone, with its own error
            estimate()
    finally:
        _each.reset(token)
    return found


def solve(
    observations: Observations,
    priors: Priors,
    problem: Callable[[Observations, Priors], Problem],
    refined: Callable[[Observations, Priors, Estimate], Problem | None] | None = None,
) -> Estimate:
    """Return the estimate, (..., p).

    Parameters
    ----------
    observations : Observations
        With or without an axis of trials.
    priors : sequence of Gaussian
    problem : callable
        Maps the observations and priors of some trials to their problem.
    refined : callable, optional
        Maps these and the estimate of the same trials to the next problem to solve, for example
        with corrected readings; None keeps the estimate.
    """

    def of_trials(part: slice) -> tuple[Observations, list[Gaussian]]:
        return observations.of_trials(part), [prior.of_trials(part) for prior in priors]

    if ready := _prepared.get():
        return ready.pop()
    lead = np.broadcast_shapes(observations.trial_shape, *(one.mean.shape[:-1] for one in priors))
    if (each := _each.get()) is not None:
        first_problem = problem(observations, priors)
        first = least_squares(first_problem) if refined else None
        then = refined(observations, priors, first) if refined and first else None
        each += least_squares_each(then or first_problem)
        raise _EachFoundError
    if len(lead) != 1:
        first = least_squares(problem(observations, priors))
        then = refined(observations, priors, first) if refined else None
        return least_squares(then) if then else first
    return least_squares_of_trials(
        lead[0],
        lambda part: problem(*of_trials(part)),
        refined=(lambda part, first: refined(*of_trials(part), first)) if refined else None,
    )

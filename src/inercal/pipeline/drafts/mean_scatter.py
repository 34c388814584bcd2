"""Find the standard deviation of means if nothing in a draft states it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from inercal.pipeline.drafts.draft_entries import DraftKey
from inercal.pipeline.drafts.draft_sections import deviation_key
from inercal.pipeline.drafts.method_trials import AUTO, Candidate, MethodTrial, try_methods

GUESS = "a guess that χ² cannot check: state the standard deviation of your means"
_FROM_RESIDUALS = (
    "the scatter that the residuals show, if the bench is as stated: state the measured scatter of "
    "your means to get a real test"
)
_SCATTER_ROUNDS, _SCATTER_AGREES = 6, 0.2


def with_scatter(
    entries: tuple[DraftKey, ...], candidates: Sequence[Candidate], folder: Path, deviation: float
) -> tuple[tuple[DraftKey, ...], tuple[MethodTrial, ...]]:
    """Try the candidates with the deviation of means that the data imply.

    If the residuals show that the guess is too large, the deviation that they imply is used.
    Otherwise the deviation is chosen so that χ² equals its degrees of freedom. Additional
    coefficients are only tested afterwards, because with too small a deviation the tests would find
    effects that do not exist.
    """
    plain = [(bench, name, {} if keys == AUTO else keys) for bench, name, keys in candidates]
    trials = try_methods(entries, plain, folder)
    outcome = next((one.outcome for one in trials if one.outcome is not None), None)
    findings = () if outcome is None else outcome.findings
    if factors := [one.factor for one in findings if one.what == "noise" and one.factor]:
        entries = _with_deviation(entries, deviation / max(factors), _FROM_RESIDUALS)
        return entries, try_methods(entries, candidates, folder)
    if plain != list(candidates):
        entries, _, deviation = _agreeing(entries, trials, plain, folder, deviation)
        trials = try_methods(entries, candidates, folder)
    return _agreeing(entries, trials, candidates, folder, deviation)[:2]


def _agreeing(
    entries: tuple[DraftKey, ...],
    trials: tuple[MethodTrial, ...],
    candidates: Sequence[Candidate],
    folder: Path,
    deviation: float,
) -> tuple[tuple[DraftKey, ...], tuple[MethodTrial, ...], float]:
    """Return entries and trials with the deviation at which χ² is near its dof, and this."""
    reason = (
        "chosen so that χ² fits, so χ² says nothing about the model: state the measured scatter of "
        "your means to get a real test"
    )
    given, before = (entries, trials, deviation), np.inf
    for _ in range(_SCATTER_ROUNDS):
        fits = [one.outcome.estimate for one in trials if one.outcome is not None]
        if not fits or not fits[0].dof:
            break
        # With few degrees of freedom this is the standard uncertainty (GUM Supplement 1, 6.4.9).
        dof = max(fits[0].dof - 2, fits[0].dof / 3)
        ratio = float(np.sqrt(max(fits[0].chi2 / dof, 1e-12)))
        if abs(ratio - 1) < _SCATTER_AGREES:
            return entries, trials, deviation
        if abs(np.log(ratio)) > 0.7 * before:
            break  # the errors of the bench explain the residuals for any scatter
        before = abs(np.log(ratio))
        deviation *= ratio
        entries = _with_deviation(entries, deviation, reason)
        trials = try_methods(entries, candidates, folder)
    return given


def _with_deviation(
    entries: tuple[DraftKey, ...], deviation: float, reason: str
) -> tuple[DraftKey, ...]:
    """Return the entries with another deviation of means; values that the user adds may follow."""
    found = deviation_key(deviation, reason)
    return tuple(found if one.dotted == found.dotted else one for one in entries)

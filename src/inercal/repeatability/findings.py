"""What sessions do not agree with, and what was assumed, in words."""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from inercal.arrays import Array
from inercal.repeatability.effects import NamedEffect
from inercal.repeatability.sessions import JoinedSessions

_CHANCE = 0.01  # of a false finding, of all axes of a group or of all sessions
_LEAST_SESSIONS = 4  # to find one that lies apart


@dataclass(frozen=True, eq=False)
class Prediction:
    """A session against the mean of the others.

    Parameters
    ----------
    chi2 : (k,) array
        Squared distance, by the covariance of the difference.
    size : int
        How many coefficients.
    dof : int
        Degrees of freedom of the scatter.
    """

    chi2: Array
    size: int
    dof: int

    @property
    def p_value(self) -> Array:
        """How likely chance makes each distance as large, (k,)."""
        return np.asarray(scipy.special.fdtrc(self.size, self.dof, self.chi2 / self.size))


def odd_axes(values: Array, groups: Mapping[tuple[str, str, float], Sequence[int]]) -> list[int]:
    """Return coefficients that scatter more than the like ones of other axes.

    Parameters
    ----------
    values : (k, p) array
    groups : mapping
        Places of like coefficients.
    """
    found: list[int] = []
    k = len(values)
    variance = np.var(values, axis=0, ddof=1)
    for places in groups.values():
        for j in places if len(places) > 1 else ():
            others = [variance[i] for i in places if i != j]
            ratio = variance[j] / max(float(np.mean(others)), 1e-300)
            chance = scipy.special.fdtrc(k - 1, (k - 1) * len(others), ratio)
            if chance < _CHANCE / len(places):
                found.append(j)
    return found


def findings(
    joined: JoinedSessions,
    groups: Mapping[tuple[str, str, float], Sequence[int]],
    effects: Sequence[NamedEffect],
    prediction: Prediction | None,
    converged: bool,
) -> tuple[str, ...]:
    """Return what a reader must know of the result, the gravest first."""
    lines: list[str] = []
    if not converged:
        lines.append("the estimate of the scatter did not converge: do not rely on it")
    if prediction is not None and len(joined.sessions) >= _LEAST_SESSIONS:
        lines += [
            f"{one.label} lies apart from the other sessions (p = {p:.1g}): was the sensor "
            "changed, or the bench?"
            for one, p in zip(joined.sessions, prediction.p_value, strict=True)
            if p < _CHANCE / len(joined.sessions)
        ]
    if prediction is not None:
        lines += [
            f"{joined.names[j]} scatters more than those of the other axes; U of the next use "
            "takes its own scatter, and covers less than 95 % with few sessions"
            for j in odd_axes(joined.values, _without_rotated(groups, effects))
        ]
    if joined.unstated:
        lines.append(
            f"{', '.join(joined.unstated)}: states no errors that calibrations share; all of its "
            "uncertainty is taken as shared, which no number of sessions lowers"
        )
    if common := [one.name for one in joined.shared if one.name and one.is_common]:
        lines.append(f"shared by all sessions, and not averaged: {', '.join(common)}")
    if joined.left_out:
        lines.append(f"not in all sessions, or fixed: {', '.join(joined.left_out)}")
    return tuple(lines)


def _without_rotated(
    groups: Mapping[tuple[str, str, float], Sequence[int]], effects: Sequence[NamedEffect]
) -> Mapping[tuple[str, str, float], Sequence[int]]:
    """Leave out what a mounting moves: its axes are not alike."""
    moved = {place for one in effects if one.level == "mount" for place in one.places}
    return {key: places for key, places in groups.items() if not moved & set(places)}

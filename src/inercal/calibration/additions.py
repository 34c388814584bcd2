"""Describe the coefficients that a run added to its model because of its score tests.

The tests rejected a fit, and these coefficients were the most likely cause. The run was then
calibrated again with them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from inercal.physics.sensors import Sensor
from inercal.physics.sensors.coefficient_selection import coefficient_words
from inercal.recordings import Finding

_MOST_NAMED = 2  # most other causes that are named before the advice


@dataclass(frozen=True)
class Addition:
    """A group of coefficients that was added to the model.

    Parameters
    ----------
    group : str
        Name of the group that [method] also accepts, such as "g" or "ax.k2".
    coefficients : tuple of str
        Full names of the coefficients.
    chi2_before, dof_before, chi2_after, dof_after : float and int
        χ² and degrees of freedom of the fits without and with the group; see `ScoreTestSet.chi2`.
    indistinguishable : tuple of str
        Other causes that would have explained these residuals equally well.
    """

    group: str
    coefficients: tuple[str, ...]
    chi2_before: float
    dof_before: int
    chi2_after: float
    dof_after: int
    indistinguishable: tuple[str, ...] = ()


def additions_text(additions: Sequence[Addition], sensor: Sensor) -> str:
    """Describe the additions in order, with the decrease of χ²; empty if there are none."""
    parts = (
        f"{coefficient_words(sensor, one.group, one.coefficients)}, "
        f"χ² from {_grouped(one.chi2_before)} to {_grouped(one.chi2_after)}"
        for one in additions
    )
    return f"Added to the model: {'; then '.join(parts)}." if additions else ""


def doubtful_additions(additions: Sequence[Addition]) -> tuple[Finding, ...]:
    """Return a warning for each addition if another cause would explain the residuals as well."""
    found: list[Finding] = []
    for one in additions:
        others = " or ".join(one.indistinguishable)
        text = f"{one.group} was added, but {others} would explain the residuals as well"
        if len(one.indistinguishable) > _MOST_NAMED:
            count = f"{len(one.indistinguishable)} other causes"
            text = (
                f"{one.group} was added, but {count} would explain the residuals as well: {others}"
            )
        if others:
            advice = "find out which one it is, and state it in the run file"
            found.append(Finding("warning", "also", f"{text}; {advice}"))
    return tuple(found)


def _grouped(chi2: float) -> str:
    return f"{chi2:,.0f}".replace(",", " ")

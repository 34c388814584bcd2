"""Describe a comparison in words, and test it against the usual scatter from run to run.

E_n and χ² test whether a sensor changed by more than the stated uncertainties allow. The
coefficients of a sensor also scatter from one turn-on, day and mounting to the next, with standard
deviation σ for each use. Two calibrations therefore differ even without a fault. If σ has ν degrees
of freedom, the difference is judged by::

    E_run = d/(t_ν √(u_d² + 2σ²))

u_d² is the variance of the difference d without shared errors, and t_ν gives the same coverage as
2u. The joint test uses the covariance C_d + 2Σ, where Σ is the covariance of the scatter.
"""

from dataclasses import dataclass
from math import isnan
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.calibration.comparison import Comparison, different_sensors
from inercal.calibration.comparison.changes import CHANCE_FRACTION, JointTest, joint_test
from inercal.calibration.comparison.common_scale import common_scale_lines
from inercal.calibration.grade import GRADE_WORDS
from inercal.calibration.specification import load_next_use
from inercal.calibration.suspect_text import p_value_text
from inercal.estimation.uncertainty.conformity import expanded_uncertainty


@dataclass(frozen=True, eq=False)
class RunScatter:
    """The scatter of a sensor's coefficients from one use to the next.

    Parameters
    ----------
    source : str
        Printed name of the source, such as "TRIAD-7.repeatability.json".
    names : tuple of p str
    covariance : (p, p) array
        Covariance of one calibration about the mean, SI, without the calibration's own uncertainty.
    dof : (p,) array
        Degrees of freedom of each coefficient.
    """

    source: str
    names: tuple[str, ...]
    covariance: Array
    dof: Array


@dataclass(frozen=True, eq=False)
class RunToRun:
    """The difference of two calibrations compared with the scatter from run to run.

    Parameters
    ----------
    source : str
    names : tuple of p str
        Coefficients with a known scatter.
    normalised_errors : (p,) array
        Normalised errors E_run.
    changed : (p,) array of bool
        Whether |E_n| > 1.
    joint : JointTest or None
    """

    source: str
    names: tuple[str, ...]
    normalised_errors: Array
    changed: NDArray[np.bool_]
    joint: JointTest | None

    @property
    def beyond(self) -> tuple[str, ...]:
        """Coefficients whose difference exceeds the usual scatter."""
        pairs = zip(self.names, self.normalised_errors, strict=True)
        return tuple(name for name, one in pairs if abs(one) > 1)

    @property
    def within(self) -> tuple[str, ...]:
        """Coefficients with |E_n| > 1 whose difference is within the usual scatter."""
        rows = zip(self.names, self.normalised_errors, self.changed, strict=True)
        return tuple(name for name, one, changed in rows if changed and abs(one) <= 1)

    @property
    def expected_exceedances(self) -> float:
        """Number of coefficients that are expected to exceed the scatter by chance."""
        return CHANCE_FRACTION * len(self.names)


def scatter_of_file(path: Path, compared: Comparison) -> RunScatter:
    """Read the scatter for a comparison from a file written by `inercal repeat`.

    Raises
    ------
    InputError
        If the file does not exist, or its frame, form or coefficients are different.
    """
    found = load_next_use(path)
    terms = compared.second.frame, compared.second.sensor.form
    if (found.frame, found.form) != terms:
        raise InputError(
            f"{path}: its frame is {found.frame} and its form is {found.form}, but the "
            f"calibrations have {terms[0]} and {terms[1]}: run inercal repeat with calibrations "
            "that have this frame and form",
            file=path,
            key="--repeatability",
        )
    if not set(found.names) & set(compared.names):
        raise InputError(
            f"{path}: the file has none of the coefficients of the calibrations, only "
            f"{', '.join(found.names)}",
            file=path,
            key="--repeatability",
        )
    return RunScatter(found.source, found.names, found.run_to_run, found.dof)


def against_scatter(compared: Comparison, scatter: RunScatter) -> RunToRun | None:
    """Compare differences with the scatter; None if no coefficient has a known scatter."""
    names = tuple(name for name in compared.names if name in scatter.names)
    if not names or not compared.states_uncertainty:
        return None
    mine = [compared.names.index(name) for name in names]
    its = [scatter.names.index(name) for name in names]
    added = 2 * scatter.covariance[np.ix_(its, its)]
    std = np.sqrt(compared.difference_std[mine] ** 2 + np.diag(added))
    covariance = compared.difference_covariance[np.ix_(mine, mine)] + added
    difference = compared.difference[mine]
    return RunToRun(
        scatter.source,
        names,
        difference / expanded_uncertainty(std, scatter.dof[its]),
        np.abs(compared.normalised_errors[mine]) > 1,
        joint_test(difference, covariance) if (np.diag(covariance) > 0).all() else None,
    )


SHARED_NOTE = "errors that both share cancel in the difference, so E_n and χ² do not include them"
INDEPENDENCE_NOTE = (
    "errors that calibrations share, such as those of the bench, are treated as independent: this "
    "makes E_n and χ² too small, so only larger changes are detected"
)

_CHANCE = 0.05  # significance level of a joint test
RUN_TO_RUN_NOTE = "E_n and χ² omit the usual scatter from run to run; inercal repeat estimates it"


def grade_text(grade: str) -> str:
    """Return a verdict's grade in words; "unknown" for a file without a grade."""
    return next((words for one, words in GRADE_WORDS.items() if one == grade), "unknown")


def format_en(value: float) -> str:
    """Return E_n as text, with a star if |E_n| exceeds 1; empty for a first calibration."""
    return "" if isnan(value) else f"{value:+.2f}{' *' if abs(value) > 1 else ''}"


def joint_test_text(test: JointTest) -> str:
    """Return the result of the joint test of all coefficients as text."""
    text = (
        f"χ² = {test.chi2:.1f} with {test.rank} degrees of freedom, p {p_value_text(test.p_value)}"
    )
    if test.rank < test.size:
        text += f" (rank {test.rank} of {test.size} coefficients)"
    return text


def comparison_lines(compared: Comparison) -> list[str]:
    """Return the text lines with the results of a comparison."""
    both = compared.first, compared.second
    serials, names = different_sensors(*((one.sensor.name, one.job) for one in both))
    apart = f"serial numbers {serials}" if serials else names
    lines = [f"the calibrations are of different sensors: {apart}"] * bool(apart)
    if compared.same_recording:
        lines.append(
            "both are from the same recording and share its errors: E_n cannot show a change"
        )
    return [*lines, *_test_lines(compared), *(f"left out: {one}" for one in compared.exclusions)]


def _test_lines(compared: Comparison) -> list[str]:
    """Return lines on the results of E_n and χ², and on the uncertainties that they use."""
    if not compared.states_uncertainty:
        return ["neither calibration states uncertainties, so E_n and χ² cannot be calculated"]
    lines = [
        f"the {word} calibration states no uncertainties, so E_n and χ² use only those of the other"
        for word, one in (("first", compared.first), ("second", compared.second))
        if not one.states_uncertainty
    ]
    lines.append(
        exceedance_text(compared.exceedances, len(compared.names), compared.expected_exceedances)
    )
    if compared.joint_test is not None:
        lines.append(f"all together: {joint_test_text(compared.joint_test)}")
    lines += common_scale_lines(compared)
    return [*lines, SHARED_NOTE if compared.states_shared else INDEPENDENCE_NOTE]


def run_to_run_lines(found: RunToRun) -> list[str]:
    """Return lines on differences that exceed the usual scatter from run to run."""
    lines = [
        f"beyond the usual scatter from run to run ({found.source}): "
        f"{', '.join(found.beyond) or 'none'} of {len(found.names)}. About "
        f"{found.expected_exceedances:.2g} would be expected by chance."
    ]
    if found.within:
        lines.append(f"|E_n| > 1, but within that scatter: {', '.join(found.within)}")
    if found.joint is not None:
        lines.append(f"all together, with that scatter: {joint_test_text(found.joint)}")
    return lines


def repeatability_lines(exceedances: int, joint: JointTest | None) -> list[str]:
    """Return a note if the usual scatter from run to run may explain a change."""
    is_changed = exceedances > 0 or (joint is not None and joint.p_value < _CHANCE)
    return [RUN_TO_RUN_NOTE] if is_changed else []


def exceedance_text(beyond: int, of: int, by_chance: float) -> str:
    """Return a line with the number of changed coefficients and the number expected by chance."""
    return f"|E_n| > 1 (*) in {beyond} of {of}. About {by_chance:.2g} would be expected by chance."

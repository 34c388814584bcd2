"""Describe the comparison of two calibrations in words and rounded numbers."""

from math import isnan

from inercal.calibration.comparison import Comparison
from inercal.calibration.comparison.changes import JointTest
from inercal.calibration.comparison.run_to_run import RunToRun
from inercal.calibration.grade import GRADE_WORDS
from inercal.calibration.suspect_text import p_value_text

SHARED_NOTE = "errors that both share cancel in the difference, so E_n and χ² do not include them"
INDEPENDENCE_NOTE = (
    "errors that calibrations share, such as those of the bench, are treated as independent: this "
    "makes E_n and χ² too small, so only larger changes are detected"
)

_CHANCE = 0.05  # significance level of a joint test
RUN_TO_RUN_NOTE = (
    "E_n and χ² do not include scatter between power cycles, days or mountings: inercal repeat "
    "estimates it from several calibrations, and --repeatability (compare, store diff) uses it"
)


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
    first, second = compared.first.sensor.name, compared.second.sensor.name
    lines = (
        [f"the calibrations are of different sensors: {first} and {second}"]
        if first != second
        else []
    )
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

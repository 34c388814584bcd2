"""The page of what no residual shows: violations that shift coefficients before their η is 6."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill

from tests.evidence.violation_cells import (
    CASES,
    FIVE_U,
    VISIBLE_ETA,
    WITHOUT_SIZE,
    Cell,
    Count,
    find_case,
    visibilities,
)
from tests.evidence.visibility_model import Violation, Visibility

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "what-the-data-cannot-tell.md"
_HEAD = (
    "| what is wrong | shifts a coefficient by 5 u at | η at that size | visible from (η = 6) "
    "| what to do | named by the verdict |"
)
_RULE = "|---|---|---|---|---|---|"
_PAGE = """\
# What the data cannot tell

Written by `make evidence`; do not edit.

If the estimated coefficients and the stated errors of the bench can absorb an error, the error
leaves no residual. The verdict is then "consistent", although the coefficients are wrong. For each
method, this page lists causes of such errors, the size at which each cause matters, and the size at
which a test would detect it.

η measures how visible a cause is. It is the norm of the residuals that the cause leaves after the
fit, where each residual is divided by its standard deviation. The cause increases χ² by η². If η is
below 6, no test of these data detects the cause reliably; at η = 6, a good test nearly always
detects it. Each row of the tables describes a cause that shifts some coefficient by 5 u (five of
its standard uncertainties) while η is still below 6. "Never" means that the cause leaves no
residual, whatever its size.

The numbers apply to one ordinary device and one ordinary bench for each method. With a different
noise or different stated uncertainties, the numbers would be different. All numbers were computed
by finite differences with simulation programs that are independent of inercal. If a cause becomes
visible before it shifts a coefficient by 5 u, this cause is only listed in [the table of
violations](../evidence/violations.md).

There are three ways to deal with such a cause. You can state a standard deviation for the cause in
the run file; then U includes it. You can let the method estimate the coefficient. If the run file
has no key for the cause, remember that the result is only valid if the cause is smaller than the
size in the second column. For causes without a key, the last column counts the simulated devices
for which the verdict names the cause. The verdict lists most of these causes under "not detectable
from these data and not included in U", with the size that shifts a coefficient by 5 u in that run.
If norms do not reveal swapped or reversed axes or lever arms, the verdict names these causes in the
line "norms … do not tell …" instead.
{sections}"""
_ABOUT = {
    "six_position": (
        "The data are a table of means from accelerometers with a noise of 30 µg; the tilt of "
        "each face may be 0.1°. The scale factors depend on the stated gravity, and the "
        "misalignments depend on the directions of the faces. Only the readings of the axes "
        "perpendicular to gravity are left for a test, and these readings include the tilt of "
        "the faces. Data with swapped columns look like data from a different device. If the "
        "plan has labels, the scale factors reveal swapped columns. If the marks were found from "
        "the readings, nothing reveals swapped columns."
    ),
    "six_position, recorded": (
        "The measurement is the same as for `six_position`, but the data are a recording. Each "
        "rest is therefore also tested for changes of the readings within the rest. If gyros are "
        "recorded with the moves between the rests, exchanged and reversed gyros are detected."
    ),
    "ferraris": (
        "The data are means from an IMU in six positions and in three turns of 360° ± 0.1°. The "
        "scale factors of the gyros depend on the stated angle of the turns and on the clock."
    ),
    "multi_position": (
        "The data are means from accelerometers in 24 attitudes, with a noise of 30 µg. The norm "
        "of the readings does not depend on the attitude. Swapped or reversed axes therefore "
        "give the same norms as correct axes, and without gyros nothing reveals them."
    ),
    "multi_position, recorded": (
        "The data are a recording of an IMU in 24 attitudes, with a noise of 100 µg/√Hz. Each "
        "attitude lasts three seconds."
    ),
    "centrifuge_norm": (
        "The data are the norms of the readings in twenty attitudes at 60, 120 and 180 r/min on "
        "an arm of 1 m. Swapped or reversed axes give the same norms as correct axes. Reversed "
        "axes can be recognised from the sign of the means at rest, or if `attitude` and "
        "`indexing` are stated."
    ),
    "dual_orthogonal": (
        "Two accelerometers are measured on a dividing head whose angle error has harmonics of "
        "1.9″ and 1.6″. An autocollimator is used in four positions."
    ),
    "tumble": (
        "One accelerometer is measured on a dividing head whose angle error has harmonics of "
        "0.5″ and 0.4″. These harmonics have the same effect on the readings as the "
        "coefficients. Only the stated size of the harmonics separates them from the "
        "coefficients."
    ),
    "rates_and_poses": (
        "Three gyros are measured on a rate table. In each setting, a different axis points up, "
        "and the gyros are measured at rest and at three rates in both directions."
    ),
    "ship_planar": "The sensor is measured in nine states in which it is level.",
    "ship_multi_angle": (
        "The sensor is measured in 25 states, in some of which it is level and in the others "
        "tilted."
    ),
    "turntable_discrete": (
        "The IMU is measured in six positions, and in each position it is turned about the "
        "vertical and back again."
    ),
    "turntable_kalman": (
        "The IMU is moved through ten positions and three turns, and each turn is made forward "
        "and back. The recording is processed by filters."
    ),
    "turntable_trajectory": (
        "The recording is the same as for `turntable_kalman`, but it is evaluated by generalised "
        "least squares."
    ),
}


@dataclass(frozen=True)
class HiddenCause:
    """One cause that the data of a case do not show in time."""

    case: str
    violation: Violation
    seen: Visibility


def hidden_causes(name: str) -> Iterator[HiddenCause]:
    """Yield the causes of a case whose η is below 6 where they shift a coefficient by 5 u."""
    for violation, seen in visibilities(name).values():
        if math.isfinite(seen.at_five) and seen.eta_at_five < VISIBLE_ETA:
            yield HiddenCause(name, violation, seen)


def _two_digits(x: float) -> str:
    """Return two significant digits without an exponent."""
    if x == 0:
        return "0"
    digits = max(0, 1 - math.floor(math.log10(abs(x))))
    return f"{round(x, 1 - math.floor(math.log10(abs(x)))):.{digits}f}"


def _count_named_causes(counted: Mapping[Cell, Count], name: str, violation: Violation) -> str:
    """Return in how many devices the verdict named a cause that no key counts, "" of others."""
    if not violation.limit:
        return ""
    cells = {(cell.case, cell.violation, cell.at): one for cell, one in counted.items()}
    at = WITHOUT_SIZE if violation.gross else FIVE_U
    one = cells.get((name, violation.name, at))
    return f"{one.printed} of {one.devices}" if one else "–"


def page_text(counted: Mapping[Cell, Count]) -> str:
    """Return the page, with what the verdicts of the devices printed."""
    sections: list[str] = []
    for name in CASES:
        rows = [
            "| "
            + " | ".join(
                (
                    line.violation.name,
                    f"{_two_digits(line.seen.at_five)} {line.violation.unit} "
                    f"({line.seen.coefficient})",
                    _two_digits(line.seen.eta_at_five) if line.seen.eta_at_five > 5e-3 else "0",
                    "never"
                    if math.isinf(line.seen.at_six)
                    else f"{_two_digits(line.seen.at_six)} {line.violation.unit}",
                    line.violation.counted,
                    _count_named_causes(counted, name, line.violation),
                )
            )
            + " |"
            for line in hidden_causes(name)
        ]
        rows += [
            f"| {one.name} | any swap or reversal | 0 | never | in one row, compare the sign of "
            f"each axis with its attitude | {_count_named_causes(counted, name, one)} |"
            for one in find_case(name).violations
            if one.symmetric
        ]
        table = (
            "\n".join([_HEAD, _RULE, *rows])
            if rows
            else "None of the causes that were tried is hidden."
        )
        sections.append(f"\n## {name}\n\n{fill(_ABOUT[name], 100)}\n\n{table}\n")
    return _PAGE.format(sections="".join(sections))


def write_page(counted: Mapping[Cell, Count]) -> None:
    """Write the page."""
    PAGE.write_text(page_text(counted), encoding="utf-8")

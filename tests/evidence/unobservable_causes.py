"""The page of what no residual shows: violations that shift coefficients before their η is 6."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

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
    "| what is wrong | shifts a coefficient by 5 u at | η there | shows at | what to do | printed |"
)
_RULE = "|---|---|---|---|---|---|"
_PAGE = """\
# What the data cannot tell

Written by `make evidence`; do not edit.

A calibration is judged by its residuals. What the coefficients and the bench's stated errors can
take up leaves no residual: the verdict is "consistent", and the coefficients are wrong. This page
lists such causes for each method, with the size at which they matter and the size at which they
would show.

η is how visible a cause is: the norm of the residual that it leaves after the fit, in standard
deviations. χ² grows by η². Below η = 6 no test of these data finds a cause reliably, whatever the
test; at 6 nearly always. Each line is a cause that shifts some coefficient by 5 u, five of its
standard uncertainties, before η is 6. "Never" means that no size leaves a residual.

The figures are those of one ordinary device and bench for each method, computed by finite
differences of generators that are no part of inercal; other noise or other stated uncertainties
move them. Causes that show before they shift a coefficient by 5 u are in
[the table of violations](../evidence/violations.md) alone.

What to do is one of three things: state a standard deviation in the run file, which puts the cause
into U; let the method estimate the coefficient; or, where the run file has no key for it, know that
the result holds within the limit that the second column gives. Of those without a key the last
column counts the devices whose verdict names the cause: in the list "not detectable from
these data and not included in U", with the size that shifts a coefficient by 5 u in that run; of
axes and lever arms that norms do not see, in the line "norms … do not tell …".
{sections}"""
_ABOUT = {
    "six_position": (
        "From a table of means: accelerometers, faces off by 0.1°, 30 µg. Scale factors rest on "
        "stated gravity, misalignments on the faces; only the readings across gravity are left to "
        "test anything, and they hold the tilt of the faces. Swapped columns make another device, "
        "which a plan with labels notices by its scale factors, and marks that were found by the "
        "readings themselves do not."
    ),
    "six_position, recorded": (
        "The same from a recording, whose rests are tested against themselves as well."
    ),
    "ferraris": (
        "An IMU in six positions and three turns of 360° ± 0.1°, from means. The gyros' scale "
        "factors rest on the stated angle of the turns and on the clock."
    ),
    "multi_position": (
        "Accelerometers in 24 attitudes, from means of 30 µg. Norms know no attitude: swapped or "
        "reversed axes make the same norms, so that without gyros nothing shows them."
    ),
    "multi_position, recorded": "An IMU in 24 attitudes, three seconds each, 100 µg/√Hz.",
    "centrifuge_norm": (
        "Twenty attitudes at 60, 120 and 180 r/min, 1 m, norms alone. A norm is the same for "
        "swapped or reversed axes: reversed axes show in the sign of the means at rest, or with "
        "`attitude` and `indexing`."
    ),
    "dual_orthogonal": (
        "Two accelerometers on a head of 1.9″ and 1.6″ with an autocollimator in four positions."
    ),
    "tumble": (
        "One accelerometer on a head of 0.5″ and 0.4″. What the head's harmonics do to the "
        "readings is what the coefficients do: they are told apart by their stated size alone."
    ),
    "rates_and_poses": (
        "Three gyros on a rate table, each axis up in a setting, at rest and at three rates of "
        "both senses."
    ),
    "ship_planar": "Nine level states.",
    "ship_multi_angle": "Level and tilted states, 25 in all.",
    "turntable_discrete": "Six positions with a turn there and back about the vertical in each.",
    "turntable_kalman": "Ten positions and three turns there and back, followed by filters.",
    "turntable_trajectory": "The same recording by generalised least squares.",
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
            f"| {one.name} | at once | 0 | never | compare the sign of each axis with its attitude "
            f"in one row | {_count_named_causes(counted, name, one)} |"
            for one in find_case(name).violations
            if one.symmetric
        ]
        table = "\n".join([_HEAD, _RULE, *rows]) if rows else "Nothing of what was tried."
        sections.append(f"\n## {name}\n\n{_ABOUT[name]}\n\n{table}\n")
    return _PAGE.format(sections="".join(sections))


def write_page(counted: Mapping[Cell, Count]) -> None:
    """Write the page."""
    PAGE.write_text(page_text(counted), encoding="utf-8")

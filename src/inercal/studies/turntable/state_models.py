"""The source's 15 and 18 states beside those with drift, delay and the table's errors."""

from collections.abc import Sequence

import numpy as np

from inercal.studies.claim import ClaimResult, format_significant
from inercal.studies.section_texts import read_section_text
from inercal.studies.study_content import Chart, Curve, StudyPanel, StudySection, StudyTable
from inercal.studies.turntable.filter_score import (
    COEFFICIENT_KINDS,
    CoefficientKind,
    coefficient_indices,
    nees,
    printed_unit_size,
    score_filter,
)
from inercal.studies.turntable.printed_accuracy import EIGHTEEN_STATES, FULL_STATES, OWN_PATH
from inercal.studies.turntable.studied_filters import ACCELEROMETER_RUNS, GYRO_RUNS, FilterErrors
from inercal.studies.turntable.turntable_trials import (
    DISCRETE_PROCEDURE,
    TURNS_BOTH_WAYS,
    TurntableTrials,
)

TEXT = read_section_text("inercal.studies.turntable", "states")
_UNITS = {
    "g": {"bias": "°/min", "scale": "ppm", "misalignment": "″"},
    "a": {"bias": "µg", "scale": "ppm", "misalignment": "″"},
}
_HEADS = ("bias", "scale, ppm", "misalignment, ″", "NEES", "its error")


def section(found: TurntableTrials) -> StudySection:
    """Return the section of the states."""
    findings: list[ClaimResult] = []
    for of, runs, name, better in (
        ("g", found.gyros, OWN_PATH, FULL_STATES),
        ("a", found.accelerometers, EIGHTEEN_STATES, "full"),
    ):
        one, other = nees(runs[name]), nees(runs[better])
        findings.append(
            TEXT.judge(f"know_{of}", *one,
                f"squared errors over stated variances, 1 where these are right; with the "
                f"table's errors as states it is {format_significant(other.value)} ± "
                f"{format_significant(other.u, 1)}")
        )  # fmt: skip
    gyros = (*GYRO_RUNS, TURNS_BOTH_WAYS, DISCRETE_PROCEDURE)
    held = (*ACCELEROMETER_RUNS, DISCRETE_PROCEDURE)
    return TEXT.section(
        findings,
        (
            _table("Gyros: RMS of the errors, bias in °/min", gyros, found.gyros, "g"),
            _table("Accelerometers: RMS of the errors, bias in µg", held, found.accelerometers,
                   "a"),
        ),
        (_chart(found, "g", (OWN_PATH, FULL_STATES)),
         _chart(found, "a", (EIGHTEEN_STATES, "full"))),
    )  # fmt: skip


def _table(
    title: str, names: Sequence[str], runs: dict[str, list[FilterErrors]], of: str
) -> StudyTable:
    rows: list[tuple[str, list[str]]] = []
    for name in names:
        one = score_filter(runs[name], of)
        figures = (one.bias, one.scale, one.misalignment, one.nees)
        rows.append(
            (
                name,
                [
                    *(format_significant(x.value) for x in figures),
                    format_significant(one.nees.u, 1),
                ],
            )
        )
    return StudyTable(title, "filter", _HEADS, rows)


def _chart(found: TurntableTrials, of: str, names: tuple[str, str]) -> Chart:
    runs = found.gyros if of == "g" else found.accelerometers
    panels: list[StudyPanel] = []
    for kind in COEFFICIENT_KINDS:
        lines: list[Curve] = []
        for name in names:
            lines += _convergence_curves(
                runs[name], kind, of, name.partition(",")[0].partition(" ")[0]
            )
        panels.append(StudyPanel("", "min", f"{kind}, {_UNITS[of][kind]}", lines))
    what = "gyros" if of == "g" else "accelerometers"
    return Chart(
        f"convergence-{of}",
        f"RMS error of the {what} over the devices, and the RMS that the filter states, against "
        "time. Where the error stays above what is stated, the filter is too sure of itself. "
        "Filters by their states; the gyros' 15 begin with the first turn.",
        panels,
    )


def _convergence_curves(
    found: Sequence[FilterErrors], kind: CoefficientKind, of: str, name: str
) -> list[Curve]:
    at, size = coefficient_indices(kind), printed_unit_size(kind, of)
    traces = [one.trace for one in found if one.trace]
    error, stated = (
        np.sqrt((np.array(x)[..., at] ** 2).mean(axis=(0, 2))) / size
        for x in ([one.error for one in traces], [one.std for one in traces])
    )
    time = traces[0].time / 60
    return [Curve(name, time, error), Curve(f"{name}, stated", time, stated)]

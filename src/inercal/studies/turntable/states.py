"""The source's 15 and 18 states beside those with drift, delay and the table's errors."""

from collections.abc import Sequence

import numpy as np

from inercal.studies.claim import Finding, shown
from inercal.studies.section import Chart, Line, Panel, Section, Table
from inercal.studies.turntable.accuracy import FULL, HELD, OWN
from inercal.studies.turntable.filters import ACCELEROMETERS, GYROS, Found
from inercal.studies.turntable.score import KINDS, Kind, nees, places, score, unit
from inercal.studies.turntable.trials import BOTH_WAYS, BY_STEPS, Trials
from inercal.studies.words import words_of

WORDS = words_of("inercal.studies.turntable", "states")
_UNITS = {
    "g": {"bias": "°/min", "scale": "ppm", "misalignment": "″"},
    "a": {"bias": "µg", "scale": "ppm", "misalignment": "″"},
}
_HEADS = ("bias", "scale, ppm", "misalignment, ″", "NEES", "its error")


def section(found: Trials) -> Section:
    """Return the section of the states."""
    findings: list[Finding] = []
    for of, runs, name, better in (
        ("g", found.gyros, OWN, FULL),
        ("a", found.accelerometers, HELD, "full"),
    ):
        one, other = nees(runs[name]), nees(runs[better])
        findings.append(
            WORDS.judge(f"know_{of}", *one,
                f"squared errors over stated variances, 1 where these are right; with the "
                f"table's errors as states it is {shown(other.value)} ± {shown(other.u, 1)}")
        )  # fmt: skip
    gyros = (*GYROS, BOTH_WAYS, BY_STEPS)
    held = (*ACCELEROMETERS, BY_STEPS)
    return WORDS.section(
        findings,
        (
            _table("Gyros: RMS of the errors, bias in °/min", gyros, found.gyros, "g"),
            _table("Accelerometers: RMS of the errors, bias in µg", held, found.accelerometers,
                   "a"),
        ),
        (_chart(found, "g", (OWN, FULL)), _chart(found, "a", (HELD, "full"))),
    )  # fmt: skip


def _table(title: str, names: Sequence[str], runs: dict[str, list[Found]], of: str) -> Table:
    rows: list[tuple[str, list[str]]] = []
    for name in names:
        one = score(runs[name], of)
        figures = (one.bias, one.scale, one.misalignment, one.nees)
        rows.append((name, [*(shown(x.value) for x in figures), shown(one.nees.u, 1)]))
    return Table(title, "filter", _HEADS, rows)


def _chart(found: Trials, of: str, names: tuple[str, str]) -> Chart:
    runs = found.gyros if of == "g" else found.accelerometers
    panels: list[Panel] = []
    for kind in KINDS:
        lines: list[Line] = []
        for name in names:
            lines += _course(runs[name], kind, of, name.partition(",")[0].partition(" ")[0])
        panels.append(Panel("", "min", f"{kind}, {_UNITS[of][kind]}", lines))
    what = "gyros" if of == "g" else "accelerometers"
    return Chart(
        f"convergence-{of}",
        f"RMS error of the {what} over the devices, and the RMS that the filter states, against "
        "time. Where the error stays above what is stated, the filter is too sure of itself. "
        "Filters by their states; the gyros' 15 begin with the first turn.",
        panels,
    )


def _course(found: Sequence[Found], kind: Kind, of: str, name: str) -> list[Line]:
    at, size = places(kind), unit(kind, of)
    traces = [one.trace for one in found if one.trace]
    error, stated = (
        np.sqrt((np.array(x)[..., at] ** 2).mean(axis=(0, 2))) / size
        for x in ([one.off for one in traces], [one.std for one in traces])
    )
    time = traces[0].time / 60
    return [Line(name, time, error), Line(f"{name}, stated", time, stated)]

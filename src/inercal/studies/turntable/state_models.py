"""Compare the source's filters, with 15 and 18 states, with fuller models, and show failures."""

from collections.abc import Sequence

import numpy as np

from inercal.studies import study
from inercal.studies.claim import ClaimResult, format_all, format_significant
from inercal.studies.turntable import turntable_trials as trials
from inercal.studies.turntable.printed_accuracy import EIGHTEEN_STATES, FULL_STATES, OWN_PATH
from inercal.studies.turntable.simulated_turntable import LATENCY

STATES_TEXT = study.read_section_text("inercal.studies.turntable", "states")
_UNITS = {
    "g": {"bias": "°/min", "scale": "ppm", "misalignment": "″"},
    "a": {"bias": "µg", "scale": "ppm", "misalignment": "″"},
}
_HEADS = ("bias", "scale, ppm", "misalignment, ″", "NEES", "its error")


def states_section(found: trials.TurntableTrials) -> study.StudySection:
    """Build the section about the filter states."""
    findings: list[ClaimResult] = []
    for of, runs, name, better in (
        ("g", found.gyros, OWN_PATH, FULL_STATES),
        ("a", found.accelerometers, EIGHTEEN_STATES, "full"),
    ):
        one, other = trials.nees(runs[name]), trials.nees(runs[better])
        findings.append(
            STATES_TEXT.judge(f"know_{of}", *one,
                f"squared errors over stated variances, 1 if these are correct; with the "
                f"table's errors as states it is {format_significant(other.value)} ± "
                f"{format_significant(other.u, 1)}")
        )  # fmt: skip
    gyros = (*trials.GYRO_RUNS, trials.TURNS_BOTH_WAYS, trials.DISCRETE_PROCEDURE)
    held = (*trials.ACCELEROMETER_RUNS, trials.DISCRETE_PROCEDURE)
    return STATES_TEXT.section(
        findings,
        (
            _states_table("Gyros: RMS of the errors, bias in °/min", gyros, found.gyros, "g"),
            _states_table("Accelerometers: RMS of the errors, bias in µg", held,
                          found.accelerometers, "a"),
        ),
        (_states_chart(found, "g", (OWN_PATH, FULL_STATES)),
         _states_chart(found, "a", (EIGHTEEN_STATES, "full"))),
    )  # fmt: skip


def _states_table(
    title: str, names: Sequence[str], runs: dict[str, list[trials.FilterErrors]], of: str
) -> study.StudyTable:
    scores = {name: trials.score_filter(runs[name], of) for name in names}
    rows = [
        (name, [*format_all(one[:4]), format_significant(one.nees.u, 1)])
        for name, one in scores.items()
    ]
    return study.StudyTable(title, "filter", _HEADS, rows)


def _states_chart(found: trials.TurntableTrials, of: str, names: tuple[str, str]) -> study.Chart:
    runs = found.gyros if of == "g" else found.accelerometers
    panels: list[study.StudyPanel] = []
    for kind in trials.COEFFICIENT_KINDS:
        lines: list[study.Curve] = []
        for name in names:
            lines += _convergence_curves(
                runs[name], kind, of, name.partition(",")[0].partition(" ")[0]
            )
        panels.append(study.StudyPanel("", "min", f"{kind}, {_UNITS[of][kind]}", lines))
    what = "gyros" if of == "g" else "accelerometers"
    return study.Chart(
        f"convergence-{of}",
        f"RMS error of the {what} over the devices, and the RMS that the filter states, against "
        "time. If the error stays above the stated value, the filter is overconfident. Filters are "
        "named by their number of states; the gyros' filter with 15 begins with the first turn.",
        panels,
    )


def _convergence_curves(
    found: Sequence[trials.FilterErrors], kind: trials.CoefficientKind, of: str, name: str
) -> list[study.Curve]:
    at, size = trials.coefficient_indices(kind), trials.printed_unit_size(kind, of)
    traces = [one.trace for one in found if one.trace]
    error, stated = (
        np.sqrt((np.array(x)[..., at] ** 2).mean(axis=(0, 2))) / size
        for x in ([one.error for one in traces], [one.std for one in traces])
    )
    time = traces[0].time / 60
    return [study.Curve(name, time, error), study.Curve(f"{name}, stated", time, stated)]


FAILURES_TEXT = study.read_section_text("inercal.studies.turntable", "failures")
NINETEEN_STATES = "19 states, own path"
_FAILURE_ROWS = (
    OWN_PATH,
    trials.OPEN_LOOP,
    trials.G_SENSITIVE_OWN_PATH,
    trials.G_SENSITIVE_FULL,
    trials.G_SENSITIVE_MODELLED,
    trials.DELAYED_15_STATES,
    trials.DELAYED_19_STATES,
)


def failures_section(found: trials.TurntableTrials) -> study.StudySection:
    """Build the section about the failures."""
    result = {name: trials.score_filter(runs, "g") for name, runs in found.gyros.items()}
    lost, own = result[trials.OPEN_LOOP], result[OWN_PATH]
    sensed, modelled = result[trials.G_SENSITIVE_OWN_PATH], result[trials.G_SENSITIVE_MODELLED]
    late, delayed = result[trials.DELAYED_15_STATES], result[trials.DELAYED_19_STATES]
    findings = (
        FAILURES_TEXT.judge("fed_back", *lost.largest_axis["misalignment"],
            f"without feedback, a raw bias of 0.3 °/s rotates the attitude until the first-order "
            f"equations no longer hold; with feedback the error is "
            f"{format_significant(own.largest_axis['misalignment'].value)}″"),
        FAILURES_TEXT.judge("ends", float(max(found.decided_at_ends)), 0.0,
            "after whole turns the effects of misalignments cancel, so none of the six can be "
            "determined; attitudes must be compared continuously"),
        FAILURES_TEXT.judge("enough", *sensed.largest_axis["misalignment"],
            f"the bias error is {format_significant(sensed.bias.value)} °/min and the NEES "
            f"{format_significant(sensed.nees.value)}; with nine more states and the whole "
            f"recording the misalignment error is "
            f"{format_significant(modelled.largest_axis['misalignment'].value)}″"),
        FAILURES_TEXT.judge("on_time", *late.largest_axis["misalignment"],
            f"the NEES is {format_significant(late.nees.value)}; if the delay is a state, the "
            f"error is {format_significant(delayed.largest_axis['misalignment'].value)}″"),
    )  # fmt: skip
    return FAILURES_TEXT.section(
        findings,
        (_failures_table(result),),
        latency_ms=LATENCY / 1e-3,
        rest=format_significant(result[trials.REST_ALONE].bias.value),
        alone=format_significant(result[NINETEEN_STATES].bias.value),
        both=format_significant(result[trials.TURNS_BOTH_WAYS].bias.value),
        whole=format_significant(result[FULL_STATES].bias.value),
    )


def _failures_table(made: dict[str, trials.FilterScore]) -> study.StudyTable:
    rows = [(name, format_all(made[name][:4])) for name in _FAILURE_ROWS]
    return study.StudyTable("Gyros: RMS of the errors if an effect is not modelled", "filter",
                 ("bias, °/min", "scale, ppm", "misalignment, ″", "NEES"), rows)  # fmt: skip

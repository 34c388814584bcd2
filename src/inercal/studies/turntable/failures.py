"""Where the method fails: what the source leaves unsaid and a user has to know."""

from inercal.studies.claim import format_significant
from inercal.studies.section_texts import read_section_text
from inercal.studies.study_content import StudySection, StudyTable
from inercal.studies.turntable.filter_score import FilterScore, score_filter
from inercal.studies.turntable.printed_accuracy import FULL_STATES, OWN_PATH
from inercal.studies.turntable.simulated_turntable import LATENCY
from inercal.studies.turntable.turntable_trials import (
    DELAYED_15_STATES,
    DELAYED_19_STATES,
    G_SENSITIVE_FULL,
    G_SENSITIVE_MODELLED,
    G_SENSITIVE_OWN_PATH,
    OPEN_LOOP,
    REST_ALONE,
    TURNS_BOTH_WAYS,
    TurntableTrials,
)

TEXT = read_section_text("inercal.studies.turntable", "failures")
NINETEEN_STATES = "19 states, own path"
_ROWS = (
    OWN_PATH,
    OPEN_LOOP,
    G_SENSITIVE_OWN_PATH,
    G_SENSITIVE_FULL,
    G_SENSITIVE_MODELLED,
    DELAYED_15_STATES,
    DELAYED_19_STATES,
)


def section(found: TurntableTrials) -> StudySection:
    """Return the section of the failures."""
    result = {name: score_filter(runs, "g") for name, runs in found.gyros.items()}
    lost, own, sensed = result[OPEN_LOOP], result[OWN_PATH], result[G_SENSITIVE_OWN_PATH]
    findings = (
        TEXT.judge("fed_back", *lost.largest_axis["misalignment"],
            f"a raw bias of 0.3 °/s turns the attitude away until first-order equations hold no "
            f"more; fed back it is {format_significant(own.largest_axis['misalignment'].value)}″"),
        TEXT.judge("ends", float(max(found.decided_at_ends)), 0.0,
            "after whole turns all that misalignments did has gone again: all six are lost, and "
            "continuous attitudes it must be"),
        TEXT.judge("enough", *sensed.largest_axis["misalignment"],
            f"bias {format_significant(sensed.bias.value)} °/min and NEES "
            f"{format_significant(sensed.nees.value)} besides; with nine more states and the whole "
            "recording "
            f"{format_significant(result[G_SENSITIVE_MODELLED].largest_axis['misalignment'].value)}″"),
        TEXT.judge("on_time", *result[DELAYED_15_STATES].largest_axis["misalignment"],
            f"NEES {format_significant(result[DELAYED_15_STATES].nees.value)}; with the delay as a "
            "state "
            f"{format_significant(result[DELAYED_19_STATES].largest_axis['misalignment'].value)}″"),
    )  # fmt: skip
    return TEXT.section(
        findings,
        (_table(result),),
        latency_ms=LATENCY / 1e-3,
        rest=format_significant(result[REST_ALONE].bias.value),
        alone=format_significant(result[NINETEEN_STATES].bias.value),
        both=format_significant(result[TURNS_BOTH_WAYS].bias.value),
        whole=format_significant(result[FULL_STATES].bias.value),
    )


def _table(made: dict[str, FilterScore]) -> StudyTable:
    rows = [
        (
            name,
            [
                format_significant(x.value)
                for x in (one.bias, one.scale, one.misalignment, one.nees)
            ],
        )
        for name, one in ((name, made[name]) for name in _ROWS)
    ]
    return StudyTable("Gyros: RMS of the errors where something is left out", "filter",
                 ("bias, °/min", "scale, ppm", "misalignment, ″", "NEES"), rows)  # fmt: skip

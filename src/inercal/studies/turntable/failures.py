"""Where the method fails: what the source leaves unsaid and a user has to know."""

from inercal.studies.claim import shown
from inercal.studies.section import Section, Table
from inercal.studies.turntable.accuracy import FULL, OWN
from inercal.studies.turntable.experiment import LATENCY
from inercal.studies.turntable.score import Score, score
from inercal.studies.turntable.trials import (
    BOTH_WAYS,
    FELT,
    FELT_OWN,
    FELT_STATES,
    LATE_15,
    LATE_19,
    OPEN,
    REST,
    Trials,
)
from inercal.studies.words import words_of

WORDS = words_of("inercal.studies.turntable", "failures")
ALONE = "19 states, own path"
_ROWS = (OWN, OPEN, FELT_OWN, FELT, FELT_STATES, LATE_15, LATE_19)


def section(found: Trials) -> Section:
    """Return the section of the failures."""
    made = {name: score(runs, "g") for name, runs in found.gyros.items()}
    lost, own, felt = made[OPEN], made[OWN], made[FELT_OWN]
    findings = (
        WORDS.judge("fed_back", *lost.worst["misalignment"],
            f"a raw bias of 0.3 °/s turns the attitude away until first-order equations hold no "
            f"more; fed back it is {shown(own.worst['misalignment'].value)}″"),
        WORDS.judge("ends", float(max(found.decided)), 0.0,
            "after whole turns all that misalignments did has gone again: all six are lost, and "
            "continuous attitudes it must be"),
        WORDS.judge("enough", *felt.worst["misalignment"],
            f"bias {shown(felt.bias.value)} °/min and NEES {shown(felt.nees.value)} besides; "
            "with nine more states and the whole recording "
            f"{shown(made[FELT_STATES].worst['misalignment'].value)}″"),
        WORDS.judge("on_time", *made[LATE_15].worst["misalignment"],
            f"NEES {shown(made[LATE_15].nees.value)}; with the delay as a state "
            f"{shown(made[LATE_19].worst['misalignment'].value)}″"),
    )  # fmt: skip
    return WORDS.section(
        findings,
        (_table(made),),
        latency_ms=LATENCY / 1e-3,
        rest=shown(made[REST].bias.value),
        alone=shown(made[ALONE].bias.value),
        both=shown(made[BOTH_WAYS].bias.value),
        whole=shown(made[FULL].bias.value),
    )


def _table(made: dict[str, Score]) -> Table:
    rows = [
        (name, [shown(x.value) for x in (one.bias, one.scale, one.misalignment, one.nees)])
        for name, one in ((name, made[name]) for name in _ROWS)
    ]
    return Table("Gyros: RMS of the errors where something is left out", "filter",
                 ("bias, °/min", "scale, ppm", "misalignment, ″", "NEES"), rows)  # fmt: skip

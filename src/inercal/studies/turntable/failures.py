"""Where the method fails: what the source leaves unsaid and a user has to know."""

from inercal.studies.claim import Claim, judge, shown
from inercal.studies.section import Section, Table
from inercal.studies.turntable.accuracy import FULL, OWN
from inercal.studies.turntable.experiment import LATE, LATENCY
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

ANGLES = 14.0  # ″
_PROCEDURE, _MODEL = "procedure, step 4", "equation 2"
FED_BACK = Claim("attitudes are subtracted, nothing is fed back: gyro misalignment", _PROCEDURE,
                 ANGLES, "″", "≤")  # fmt: skip
ENDS = Claim("attitudes are compared after each turn: gyro coefficients decided", _PROCEDURE, 12.0,
             "", "≥", basis="words")  # fmt: skip
ENOUGH = Claim("twelve coefficients are enough at 10 °/h/g: gyro misalignment", _MODEL, ANGLES, "″",
               "≤")  # fmt: skip
ON_TIME = Claim(f"the table's attitude is taken as it comes, {LATE / 1e-3:g} ms late: gyro "
                "misalignment", _PROCEDURE, ANGLES, "″", "≤")  # fmt: skip
ALONE = "19 states, own path"
_ROWS = (OWN, OPEN, FELT_OWN, FELT, FELT_STATES, LATE_15, LATE_19)


def section(found: Trials) -> Section:
    """Return the section of the failures."""
    made = {name: score(runs, "g") for name, runs in found.gyros.items()}
    lost, own, felt = made[OPEN], made[OWN], made[FELT_OWN]
    findings = (
        judge(FED_BACK, *lost.worst["misalignment"],
              f"a raw bias of 0.3 °/s turns the attitude away until first-order equations hold no "
              f"more; fed back it is {shown(own.worst['misalignment'].value)}″"),
        judge(ENDS, float(max(found.decided)), 0.0,
              "after whole turns all that misalignments did has gone again: all six are lost, and "
              "continuous attitudes it must be"),
        judge(ENOUGH, *felt.worst["misalignment"],
              f"bias {shown(felt.bias.value)} °/min and NEES {shown(felt.nees.value)} besides; "
              "with nine more states and the whole recording "
              f"{shown(made[FELT_STATES].worst['misalignment'].value)}″"),
        judge(ON_TIME, *made[LATE_15].worst["misalignment"],
              f"NEES {shown(made[LATE_15].nees.value)}; with the delay as a state "
              f"{shown(made[LATE_19].worst['misalignment'].value)}″"),
    )  # fmt: skip
    return Section(
        "failures",
        "Failures: what the source leaves unsaid",
        (
            "The source does not say whether what the filters find is fed back, nor whether "
            "attitudes are compared all along or after each turn, nor how late the table's "
            f"attitude is. All other figures here are with {LATENCY / 1e-3:g} ms.",
            _one_way(made),
        ),
        findings,
        (_table(made),),
    )


def _one_way(made: dict[str, Score]) -> str:
    alone, own, both, whole = (
        shown(made[name].bias.value) for name in (REST, ALONE, BOTH_WAYS, FULL)
    )
    return (
        "Turns in one sense leave the gyros' biases to the rests: 72 s of rest alone tell them to "
        f"{alone} °/min, with the three turns {own}; there and back at 30 °/s in the same time "
        f"{both}, and the whole recording {whole}."
    )


def _table(made: dict[str, Score]) -> Table:
    rows = [
        (name, [shown(x.value) for x in (one.bias, one.scale, one.misalignment, one.nees)])
        for name, one in ((name, made[name]) for name in _ROWS)
    ]
    return Table("Gyros: RMS of the errors where something is left out", "filter",
                 ("bias, °/min", "scale, ppm", "misalignment, ″", "NEES"), rows)  # fmt: skip

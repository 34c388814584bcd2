"""Half an hour instead of three: the duration of the paths and the accuracy that they reach."""

from inercal.benches.turntable.paths import discrete_path, fast_path, paper_path
from inercal.benches.turntable.simulation import turntable_path_duration
from inercal.studies.claim import format_significant
from inercal.studies.rms import Rms
from inercal.studies.section_texts import read_section_text
from inercal.studies.study_content import StudySection, StudyTable
from inercal.studies.turntable.filter_score import FilterScore, score_filter
from inercal.studies.turntable.printed_accuracy import EIGHTEEN_STATES, FULL_STATES, OWN_PATH
from inercal.studies.turntable.simulated_turntable import TABLE
from inercal.studies.turntable.turntable_trials import DISCRETE_PROCEDURE, TurntableTrials

TEXT = read_section_text("inercal.studies.turntable", "time")
_PATHS = {"paper": paper_path, "fast": fast_path, "discrete": discrete_path}


def path_minutes() -> dict[str, float]:
    """Return the duration of each path with all its moves, min."""
    return {name: turntable_path_duration(TABLE, path()) / 60 for name, path in _PATHS.items()}


def rms_ratio(one: Rms, other: Rms) -> Rms:
    """Return the ratio of independent figures."""
    value = one.value / other.value
    return Rms(value, value * ((one.u / one.value) ** 2 + (other.u / other.value) ** 2) ** 0.5)


def section(found: TurntableTrials) -> StudySection:
    """Return the section of the time."""
    minutes = path_minutes()
    gyros = {
        name: score_filter(found.gyros[name], "g")
        for name in (OWN_PATH, FULL_STATES, DISCRETE_PROCEDURE)
    }
    held = {
        name: score_filter(found.accelerometers[name], "a")
        for name in (EIGHTEEN_STATES, "full", DISCRETE_PROCEDURE)
    }
    angles = {
        of: ", ".join(
            f"{format_significant(x.misalignment.value)}″ by {name}" for name, x in some.items()
        )
        for of, some in (("g", gyros), ("a", held))
    }
    findings = (
        TEXT.judge("short", minutes["paper"], 0.0,
            "2 min of warm-up, ten positions of 90 s, three turns, 72 s of rest and all moves at "
            "30 °/s and 30 °/s²"),
        TEXT.judge("long", minutes["discrete"], 0.0,
            "six positions of 90 s and ±1080° at 30 °/s about the vertical in each, on the same "
            "table; by hand and without a plan it may well take three hours"),
        TEXT.judge("gyro_as_good",
            *rms_ratio(gyros[OWN_PATH].misalignment, gyros[DISCRETE_PROCEDURE].misalignment),
            f"{angles['g']}: at 30 °/s scale and misalignment are known better than at 10 °/s"),
        TEXT.judge("accelerometer_as_good",
            *rms_ratio(held[EIGHTEEN_STATES].misalignment, held[DISCRETE_PROCEDURE].misalignment),
            angles["a"]),
    )  # fmt: skip
    return TEXT.section(findings, (_table(minutes, gyros, held),))


def _table(
    minutes: dict[str, float], gyros: dict[str, FilterScore], held: dict[str, FilterScore]
) -> StudyTable:
    rows: list[tuple[str, list[str]]] = []
    for words, path, one, other in (
        ("source's path, 15 and 18 states", "paper", OWN_PATH, EIGHTEEN_STATES),
        ("source's path, full, whole recording", "paper", FULL_STATES, "full"),
        ("six positions and steady rates", "discrete", DISCRETE_PROCEDURE, DISCRETE_PROCEDURE),
    ):
        both = (*gyros[one][:3], *held[other][:3])
        rows.append(
            (
                words,
                [format_significant(minutes[path]), *(format_significant(x.value) for x in both)],
            )
        )
    heads = ("min", "bias,\n°/min", "scale,\nppm", "angles,\n″", "bias,\nµg", "scale,\nppm",
             "angles,\n″")  # fmt: skip
    return StudyTable("Time, and RMS of the gyros' and of the accelerometers' errors", "way", heads,
                 rows)  # fmt: skip

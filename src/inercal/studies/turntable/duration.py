"""Half an hour instead of three: how long the paths take, and what each minute is worth."""

from inercal.benches.turntable.paths import discrete, fast, paper
from inercal.benches.turntable.simulation import seconds_on_turntable
from inercal.studies.claim import shown
from inercal.studies.rms import Rms
from inercal.studies.section import Section, Table
from inercal.studies.turntable.accuracy import FULL, HELD, OWN
from inercal.studies.turntable.experiment import TABLE
from inercal.studies.turntable.score import Score, score
from inercal.studies.turntable.trials import BY_STEPS, Trials
from inercal.studies.words import words_of

WORDS = words_of("inercal.studies.turntable", "time")
_PATHS = {"paper": paper, "fast": fast, "discrete": discrete}


def minutes() -> dict[str, float]:
    """Return how long each path takes with all its moves, min."""
    return {name: seconds_on_turntable(TABLE, path()) / 60 for name, path in _PATHS.items()}


def over(one: Rms, other: Rms) -> Rms:
    """Return the ratio of independent figures."""
    value = one.value / other.value
    return Rms(value, value * ((one.u / one.value) ** 2 + (other.u / other.value) ** 2) ** 0.5)


def section(found: Trials) -> Section:
    """Return the section of the time."""
    lasting = minutes()
    gyros = {name: score(found.gyros[name], "g") for name in (OWN, FULL, BY_STEPS)}
    held = {name: score(found.accelerometers[name], "a") for name in (HELD, "full", BY_STEPS)}
    told = {
        of: ", ".join(f"{shown(x.misalignment.value)}″ by {name}" for name, x in some.items())
        for of, some in (("g", gyros), ("a", held))
    }
    findings = (
        WORDS.judge("short", lasting["paper"], 0.0,
            "2 min of warm-up, ten positions of 90 s, three turns, 72 s of rest and all moves at "
            "30 °/s and 30 °/s²"),
        WORDS.judge("long", lasting["discrete"], 0.0,
            "six positions of 90 s and ±1080° at 30 °/s about the vertical in each, on the same "
            "table; by hand and without a plan it may well take three hours"),
        WORDS.judge("gyro_as_good",
            *over(gyros[OWN].misalignment, gyros[BY_STEPS].misalignment),
            f"{told['g']}: 30 °/s tell scale and misalignment better than 10"),
        WORDS.judge("accelerometer_as_good",
            *over(held[HELD].misalignment, held[BY_STEPS].misalignment),
            told["a"]),
    )  # fmt: skip
    return WORDS.section(findings, (_table(lasting, gyros, held),))


def _table(lasting: dict[str, float], gyros: dict[str, Score], held: dict[str, Score]) -> Table:
    rows: list[tuple[str, list[str]]] = []
    for words, path, one, other in (
        ("source's path, 15 and 18 states", "paper", OWN, HELD),
        ("source's path, full, whole recording", "paper", FULL, "full"),
        ("six positions and steady rates", "discrete", BY_STEPS, BY_STEPS),
    ):
        both = (*gyros[one][:3], *held[other][:3])
        rows.append((words, [shown(lasting[path]), *(shown(x.value) for x in both)]))
    heads = ("min", "bias,\n°/min", "scale,\nppm", "angles,\n″", "bias,\nµg", "scale,\nppm",
             "angles,\n″")  # fmt: skip
    return Table("Time, and RMS of the gyros' and of the accelerometers' errors", "way", heads,
                 rows)  # fmt: skip

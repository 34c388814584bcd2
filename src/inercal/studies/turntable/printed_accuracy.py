"""Compare the printed accuracy and duration with those of filters and paths."""

from math import sqrt

import numpy as np

from inercal.benches.turntable.paths import discrete_path, fast_path, paper_path
from inercal.benches.turntable.simulation import turntable_path_duration
from inercal.physics.sensors import G0
from inercal.studies import study
from inercal.studies.claim import ClaimResult, Rms, format_all, format_significant
from inercal.studies.turntable.simulated_turntable import ARW, MICRO_G, PPM, TABLE
from inercal.studies.turntable.turntable_trials import (
    COEFFICIENT_KINDS,
    DISCRETE_PROCEDURE,
    REST_ALONE,
    FilterScore,
    TurntableTrials,
    coefficient_indices,
    score_filter,
    share_within_bound,
)

ACCURACY_TEXT = study.read_section_text("inercal.studies.turntable", "accuracy")
BIAS_BOUND = ACCURACY_TEXT.claims["gyro_bias"].expected  # °/min
REST_SECONDS = 72.0  # s, duration of the rest
OWN_PATH, WHOLE_RECORDING = "15 states, own path", "19 states, whole recording"
FULL_STATES, EIGHTEEN_STATES = "full, whole recording", "18 states"
_PRINTED_UNITS = {"g": {"bias": 1.0, "scale": PPM, "misalignment": 1.0},
                  "a": {"bias": MICRO_G / G0, "scale": PPM, "misalignment": 1.0}}  # fmt: skip
_SENSOR_NAMES = {"g": "gyro", "a": "accelerometer"}
_CHARTED_FILTERS = {OWN_PATH: "15", "19 states, own path": "19", WHOLE_RECORDING: "19, whole",
                    FULL_STATES: "full", DISCRETE_PROCEDURE: "discrete"}  # fmt: skip


def required_random_walk(seconds: float, bound: float = BIAS_BOUND) -> float:
    """Return the largest angle random walk, °/√h, with which a rest gives a bias to a bound.

    The bound is in °/min. The error of a mean over T is N/√T: N [°/√h] / √T [h] is in °/h, and 1
    °/min is 60 °/h.

    >>> round(required_random_walk(72.0), 3)
    0.034
    """
    return bound * 60 * sqrt(seconds / 3600)


def accuracy_section(found: TurntableTrials) -> study.StudySection:
    """Build the section about the printed accuracy."""
    return ACCURACY_TEXT.section(
        (*_gyro_findings(found), *_accelerometer_findings(found)),
        (),
        (_chart(found),),
        seconds=REST_SECONDS,
        bias=BIAS_BOUND,
        walk=format_significant(required_random_walk(REST_SECONDS)),
    )


def _gyro_findings(found: TurntableTrials) -> list[ClaimResult]:
    result = {
        name: score_filter(found.gyros[name], "g")
        for name in (OWN_PATH, WHOLE_RECORDING, FULL_STATES)
    }
    own, whole, rest = (
        result[OWN_PATH].largest_axis,
        result[WHOLE_RECORDING].largest_axis,
        score_filter(found.gyros[REST_ALONE], "g").bias,
    )
    share = {name: _share_text(found, name) for name in (OWN_PATH, WHOLE_RECORDING)}
    alone = format_significant(ARW / required_random_walk(REST_SECONDS) * BIAS_BOUND)
    reasons = {
        "bias": f"{share[OWN_PATH]} of the devices reach it on all three axes",
        "scale": f"{format_significant(own['scale'].value)} ppm",
        "misalignment": format_significant(result[OWN_PATH].misalignment.value)
        + "″ RMS of all six",
    }
    return [
        ACCURACY_TEXT.judge("gyro_bias", *own["bias"], reasons["bias"]),
        ACCURACY_TEXT.judge("at_rest", *rest,
            f"RMS of one axis; its white noise already gives {alone} °/min, and "
            f"{format_significant(required_random_walk(REST_SECONDS))} °/√h would be sufficient"),
        ACCURACY_TEXT.judge("better", *whole["bias"],
            f"{share[WHOLE_RECORDING]} of the devices reach it on all three axes, with an RMS of "
            f"one axis of {format_significant(result[WHOLE_RECORDING].bias.value)} °/min"),
        *(
            ACCURACY_TEXT.judge(f"gyro_{kind}", *_in_printed_unit(own[kind], "g", kind),
                reasons[kind])
            for kind in COEFFICIENT_KINDS if kind != "bias"
        ),
    ]  # fmt: skip


def _accelerometer_findings(found: TurntableTrials) -> list[ClaimResult]:
    result = score_filter(found.accelerometers[EIGHTEEN_STATES], "a")
    words = {
        "bias": f"{format_significant(result.largest_axis['bias'].value)} µg",
        "scale": f"{format_significant(result.largest_axis['scale'].value)} ppm",
        "misalignment": f"{format_significant(result.misalignment.value)}″ RMS of all six",
    }
    return [
        ACCURACY_TEXT.judge(
            f"accelerometer_{kind}",
            *_in_printed_unit(result.largest_axis[kind], "a", kind),
            words[kind],
        )
        for kind in COEFFICIENT_KINDS
    ]


def _share_text(found: TurntableTrials, name: str) -> str:
    share = share_within_bound(found.gyros[name], coefficient_indices("bias"), BIAS_BOUND)
    return f"{share:.0%}"


def _in_printed_unit(one: Rms, of: str, kind: str) -> Rms:
    """Convert a result to the printed unit."""
    size = _PRINTED_UNITS[of][kind]
    return Rms(one.value * size, one.u * size)


def _chart(found: TurntableTrials) -> study.Chart:
    held = {
        EIGHTEEN_STATES: "18",
        "25 states": "25",
        "full": "full",
        DISCRETE_PROCEDURE: "discrete",
    }
    panels = [
        study.StudyPanel("", "", f"worst {_SENSOR_NAMES[of]}, over its bound",
              [_filter_marks(score_filter(runs[name], of), of, short, 0.08 * (k - 2))
               for k, (name, short) in enumerate(names.items())], names=tuple(COEFFICIENT_KINDS))
        for of, runs, names in (
            ("g", found.gyros, _CHARTED_FILTERS), ("a", found.accelerometers, held)
        )
    ]  # fmt: skip
    return study.Chart(
        "methods",
        "Error of the worst axis, RMS over devices, divided by the printed bound; above 1 the "
        "bound is not met. Filters are named by their number of states; 19 is used on the source's "
        "path and on the whole recording. Scale factors and the accelerometers' bias are a hundred "
        "times better than in print.",
        panels,
    )


def _filter_marks(one: FilterScore, of: str, name: str, aside: float) -> study.Curve:
    """Return the marks of one filter with a small offset, because some filters agree."""
    over_bound = [
        _in_printed_unit(one.largest_axis[kind], of, kind).value
        / ACCURACY_TEXT.claims[f"{_SENSOR_NAMES[of]}_{kind}"].expected
        for kind in COEFFICIENT_KINDS
    ]
    places = np.arange(float(len(over_bound))) + aside
    return study.Curve(name, places, np.array(over_bound), connected=False)


TIME_TEXT = study.read_section_text("inercal.studies.turntable", "time")
_PATHS = {"paper": paper_path, "fast": fast_path, "discrete": discrete_path}


def path_minutes() -> dict[str, float]:
    """Return the duration of each path including all moves, min."""
    return {name: turntable_path_duration(TABLE, path()) / 60 for name, path in _PATHS.items()}


def rms_ratio(one: Rms, other: Rms) -> Rms:
    """Return the ratio of two independent results."""
    value = one.value / other.value
    return Rms(value, value * ((one.u / one.value) ** 2 + (other.u / other.value) ** 2) ** 0.5)


def time_section(found: TurntableTrials) -> study.StudySection:
    """Build the section about the duration."""
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
            f"{format_significant(x.misalignment.value)}″ with {name}" for name, x in some.items()
        )
        for of, some in (("g", gyros), ("a", held))
    }
    findings = (
        TIME_TEXT.judge("short", minutes["paper"], 0.0,
            "2 min of warm-up, ten positions of 90 s, three turns, 72 s at rest and all moves at "
            "30 °/s and 30 °/s²"),
        TIME_TEXT.judge("long", minutes["discrete"], 0.0,
            "six positions of 90 s and ±1080° at 30 °/s about the vertical in each, on the same "
            "table; by hand and without a plan it may easily take three hours"),
        TIME_TEXT.judge("gyro_as_good",
            *rms_ratio(gyros[OWN_PATH].misalignment, gyros[DISCRETE_PROCEDURE].misalignment),
            f"{angles['g']}: scale and misalignment are known better at 30 °/s than at 10 °/s"),
        TIME_TEXT.judge("accelerometer_as_good",
            *rms_ratio(held[EIGHTEEN_STATES].misalignment, held[DISCRETE_PROCEDURE].misalignment),
            angles["a"]),
    )  # fmt: skip
    return TIME_TEXT.section(findings, (_time_table(minutes, gyros, held),))


def _time_table(
    minutes: dict[str, float], gyros: dict[str, FilterScore], held: dict[str, FilterScore]
) -> study.StudyTable:
    ways = (
        ("source's path, 15 and 18 states", "paper", OWN_PATH, EIGHTEEN_STATES),
        ("source's path, full, whole recording", "paper", FULL_STATES, "full"),
        ("six positions and steady rates", "discrete", DISCRETE_PROCEDURE, DISCRETE_PROCEDURE),
    )
    rows = [
        (words, format_all((minutes[path], *gyros[one][:3], *held[other][:3])))
        for words, path, one, other in ways
    ]
    heads = ("min", "bias,\n°/min", "scale,\nppm", "angles,\n″", "bias,\nµg", "scale,\nppm",
             "angles,\n″")  # fmt: skip
    return study.StudyTable(
        "Duration, and RMS errors of the gyros and accelerometers", "way", heads, rows
    )

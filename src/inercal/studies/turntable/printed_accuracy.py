"""Compare the printed accuracy, duration and states with those of other filters and paths.

Failures show what the source's filters, with 15 and 18 states, leave out.
"""

from collections.abc import Sequence
from math import sqrt

import numpy as np

from inercal.benches.turntable.paths import discrete_path, fast_path, paper_path
from inercal.benches.turntable.simulation import turntable_path_duration
from inercal.physics.sensors import G0
from inercal.studies import study
from inercal.studies.claim import ClaimResult, Rms, format_all, shown
from inercal.studies.turntable import turntable_trials as trials
from inercal.studies.turntable.simulated_turntable import ARW, LATENCY, MICRO_G, PPM, TABLE

ACCURACY_TEXT = study.read_section_text("inercal.studies.turntable", "accuracy")
BIAS_BOUND = ACCURACY_TEXT.claims["gyro_bias"].expected  # °/min
REST_SECONDS = 72.0  # s, duration of the rest
OWN_PATH, WHOLE_RECORDING = "15 states, own path", "19 states, whole recording"
FULL_STATES, EIGHTEEN_STATES = "full, whole recording", "18 states"
NINETEEN_STATES = "19 states, own path"
_PRINTED_UNITS = {"g": {"bias": 1.0, "scale": PPM, "misalignment": 1.0},
                  "a": {"bias": MICRO_G / G0, "scale": PPM, "misalignment": 1.0}}  # fmt: skip
_SENSOR_NAMES = {"g": "gyro", "a": "accelerometer"}
_CHARTED_FILTERS = {OWN_PATH: "15", NINETEEN_STATES: "19", WHOLE_RECORDING: "19, whole",
                    FULL_STATES: "full", trials.DISCRETE_PROCEDURE: "discrete"}  # fmt: skip


def required_random_walk(seconds: float, bound: float = BIAS_BOUND) -> float:
    """Return the largest angle random walk, °/√h, with which a rest gives a bias to a bound.

    The bound is in °/min. The error of a mean over T is N/√T: N [°/√h] / √T [h] is in °/h, and 1
    °/min is 60 °/h.

    >>> round(required_random_walk(72.0), 3)
    0.034
    """
    return bound * 60 * sqrt(seconds / 3600)


def accuracy_section(found: trials.TurntableTrials) -> study.StudySection:
    """Build the section about the printed accuracy."""
    return ACCURACY_TEXT.section(
        *_gyro_findings(found),
        *_accelerometer_findings(found),
        _chart(found),
        seconds=REST_SECONDS,
        bias=BIAS_BOUND,
        walk=shown(required_random_walk(REST_SECONDS)),
    )


def _gyro_findings(found: trials.TurntableTrials) -> list[ClaimResult]:
    result = {
        name: trials.score_filter(found.gyros[name], "g")
        for name in (OWN_PATH, WHOLE_RECORDING, FULL_STATES)
    }
    own, whole, rest = (
        result[OWN_PATH].largest_axis,
        result[WHOLE_RECORDING].largest_axis,
        trials.score_filter(found.gyros[trials.REST_ALONE], "g").bias,
    )
    share = {name: _share_text(found, name) for name in (OWN_PATH, WHOLE_RECORDING)}
    alone = shown(ARW / required_random_walk(REST_SECONDS) * BIAS_BOUND)
    reasons = {
        "bias": f"{share[OWN_PATH]} of the devices reach it on all three axes",
        "scale": f"{shown(own['scale'].value)} ppm",
        "misalignment": shown(result[OWN_PATH].misalignment.value) + "″ RMS of all six",
    }
    return [
        ACCURACY_TEXT.judge("gyro_bias", *own["bias"], reasons["bias"]),
        ACCURACY_TEXT.judge("at_rest", *rest,
            f"RMS of one axis; its white noise already gives {alone} °/min, and "
            f"{shown(required_random_walk(REST_SECONDS))} °/√h would be sufficient"),
        ACCURACY_TEXT.judge("better", *whole["bias"],
            f"{share[WHOLE_RECORDING]} of the devices reach it on all three axes, with an RMS of "
            f"one axis of {shown(result[WHOLE_RECORDING].bias.value)} °/min"),
        *(
            ACCURACY_TEXT.judge(f"gyro_{kind}", *_in_printed_unit(own[kind], "g", kind),
                reasons[kind])
            for kind in trials.COEFFICIENT_KINDS if kind != "bias"
        ),
    ]  # fmt: skip


def _accelerometer_findings(found: trials.TurntableTrials) -> list[ClaimResult]:
    result = trials.score_filter(found.accelerometers[EIGHTEEN_STATES], "a")
    words = {
        "bias": f"{shown(result.largest_axis['bias'].value)} µg",
        "scale": f"{shown(result.largest_axis['scale'].value)} ppm",
        "misalignment": f"{shown(result.misalignment.value)}″ RMS of all six",
    }
    return [
        ACCURACY_TEXT.judge(
            f"accelerometer_{kind}",
            *_in_printed_unit(result.largest_axis[kind], "a", kind),
            words[kind],
        )
        for kind in trials.COEFFICIENT_KINDS
    ]


def _share_text(found: trials.TurntableTrials, name: str) -> str:
    share = trials.share_within_bound(
        found.gyros[name], trials.coefficient_indices("bias"), BIAS_BOUND
    )
    return f"{share:.0%}"


def _in_printed_unit(one: Rms, of: str, kind: str) -> Rms:
    """Convert a result to the printed unit."""
    size = _PRINTED_UNITS[of][kind]
    return Rms(one.value * size, one.u * size)


def _chart(found: trials.TurntableTrials) -> study.Chart:
    held = {
        EIGHTEEN_STATES: "18",
        "25 states": "25",
        "full": "full",
        trials.DISCRETE_PROCEDURE: "discrete",
    }
    panels = [
        study.StudyPanel("", "", f"worst {_SENSOR_NAMES[of]}, over its bound",
              [_filter_marks(trials.score_filter(runs[name], of), of, short, 0.08 * (k - 2))
               for k, (name, short) in enumerate(names.items())],
              names=tuple(trials.COEFFICIENT_KINDS))
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


def _filter_marks(one: trials.FilterScore, of: str, name: str, aside: float) -> study.Curve:
    """Return the marks of one filter with a small offset, because some filters agree."""
    over_bound = [
        _in_printed_unit(one.largest_axis[kind], of, kind).value
        / ACCURACY_TEXT.claims[f"{_SENSOR_NAMES[of]}_{kind}"].expected
        for kind in trials.COEFFICIENT_KINDS
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


def time_section(found: trials.TurntableTrials) -> study.StudySection:
    """Build the section about the duration."""
    minutes = path_minutes()
    gyros = {
        name: trials.score_filter(found.gyros[name], "g")
        for name in (OWN_PATH, FULL_STATES, trials.DISCRETE_PROCEDURE)
    }
    held = {
        name: trials.score_filter(found.accelerometers[name], "a")
        for name in (EIGHTEEN_STATES, "full", trials.DISCRETE_PROCEDURE)
    }
    angles = {
        of: ", ".join(f"{shown(x.misalignment.value)}″ with {name}" for name, x in some.items())
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
            *rms_ratio(gyros[OWN_PATH].misalignment, gyros[trials.DISCRETE_PROCEDURE].misalignment),
            f"{angles['g']}: scale and misalignment are known better at 30 °/s than at 10 °/s"),
        TIME_TEXT.judge("accelerometer_as_good",
            *rms_ratio(held[EIGHTEEN_STATES].misalignment,
                       held[trials.DISCRETE_PROCEDURE].misalignment),
            angles["a"]),
    )  # fmt: skip
    return TIME_TEXT.section(*findings, _time_table(minutes, gyros, held))


def _time_table(
    minutes: dict[str, float],
    gyros: dict[str, trials.FilterScore],
    held: dict[str, trials.FilterScore],
) -> study.StudyTable:
    ways = (
        ("source's path, 15 and 18 states", "paper", OWN_PATH, EIGHTEEN_STATES),
        ("source's path, full, whole recording", "paper", FULL_STATES, "full"),
        (
            "six positions and steady rates",
            "discrete",
            trials.DISCRETE_PROCEDURE,
            trials.DISCRETE_PROCEDURE,
        ),
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
                "squared errors over stated variances, 1 if these are correct; with the table's "
                f"errors as states it is {shown(other.value)} ± {shown(other.u, 1)}")
        )  # fmt: skip
    gyros = (*trials.GYRO_RUNS, trials.TURNS_BOTH_WAYS, trials.DISCRETE_PROCEDURE)
    held = (*trials.ACCELEROMETER_RUNS, trials.DISCRETE_PROCEDURE)
    return STATES_TEXT.section(
        *findings,
        _states_table("Gyros: RMS of the errors, bias in °/min", gyros, found.gyros, "g"),
        _states_table("Accelerometers: RMS of the errors, bias in µg", held,
                      found.accelerometers, "a"),
        _states_chart(found, "g", (OWN_PATH, FULL_STATES)),
         _states_chart(found, "a", (EIGHTEEN_STATES, "full")),
    )  # fmt: skip


def _states_table(
    title: str, names: Sequence[str], runs: dict[str, list[trials.FilterErrors]], of: str
) -> study.StudyTable:
    scores = {name: trials.score_filter(runs[name], of) for name in names}
    rows = [(name, [*format_all(one[:4]), shown(one.nees.u, 1)]) for name, one in scores.items()]
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
    return study.Chart(
        f"convergence-{of}",
        f"RMS error of the {_SENSOR_NAMES[of]}s over the devices, and the RMS that the filter "
        "states, against time. If the error stays above the stated value, the filter is "
        "overconfident. Filters are named by their number of states; the gyros' filter with 15 "
        "begins with the first turn.",
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
            f"{shown(own.largest_axis['misalignment'].value)}″"),
        FAILURES_TEXT.judge("ends", float(max(found.decided_at_ends)), 0.0,
            "after whole turns the effects of misalignments cancel, so none of the six can be "
            "determined; attitudes must be compared continuously"),
        FAILURES_TEXT.judge("enough", *sensed.largest_axis["misalignment"],
            f"the bias error is {shown(sensed.bias.value)} °/min and the NEES "
            f"{shown(sensed.nees.value)}; with nine more states and the whole recording the "
            f"misalignment error is {shown(modelled.largest_axis['misalignment'].value)}″"),
        FAILURES_TEXT.judge("on_time", *late.largest_axis["misalignment"],
            f"the NEES is {shown(late.nees.value)}; if the delay is a state, the "
            f"error is {shown(delayed.largest_axis['misalignment'].value)}″"),
    )  # fmt: skip
    return FAILURES_TEXT.section(
        *findings,
        _failures_table(result),
        latency_ms=LATENCY / 1e-3,
        rest=shown(result[trials.REST_ALONE].bias.value),
        alone=shown(result[NINETEEN_STATES].bias.value),
        both=shown(result[trials.TURNS_BOTH_WAYS].bias.value),
        whole=shown(result[FULL_STATES].bias.value),
    )


def _failures_table(made: dict[str, trials.FilterScore]) -> study.StudyTable:
    rows = [(name, format_all(made[name][:4])) for name in _FAILURE_ROWS]
    return study.StudyTable("Gyros: RMS of the errors if an effect is not modelled", "filter",
                 ("bias, °/min", "scale, ppm", "misalignment, ″", "NEES"), rows)  # fmt: skip

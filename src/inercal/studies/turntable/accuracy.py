"""The printed accuracy: what 15 and 18 states reach, and what it would take for the gyros' bias."""

from math import sqrt

import numpy as np

from inercal.sensors import G0
from inercal.studies.claim import Finding, shown
from inercal.studies.rms import Rms
from inercal.studies.section import Chart, Line, Panel, Section
from inercal.studies.turntable.experiment import ARW, MICRO_G, PPM
from inercal.studies.turntable.score import KINDS, Score, places, score
from inercal.studies.turntable.trials import BY_STEPS, REST, Trials, reached
from inercal.studies.words import words_of

WORDS = words_of("inercal.studies.turntable", "accuracy")
BIAS = WORDS.claims["gyro_bias"].expected  # °/min
SECONDS = 72.0  # of the rest
OWN, WHOLE = "15 states, own path", "19 states, whole recording"
FULL, HELD = "full, whole recording", "18 states"
_PRINTED = {"g": {"bias": 1.0, "scale": PPM, "misalignment": 1.0},
              "a": {"bias": MICRO_G / G0, "scale": PPM, "misalignment": 1.0}}  # fmt: skip
_NAMES = {"g": "gyro", "a": "accelerometer"}
_CHARTED = {OWN: "15", "19 states, own path": "19", WHOLE: "19, whole", FULL: "full",
            BY_STEPS: "discrete"}  # fmt: skip


def enough(seconds: float, bound: float = BIAS) -> float:
    """Return the angle random walk that tells a bias to a bound, °/min, within a rest, °/√h.

    A mean over T is off by N/√T: N [°/√h] / √T [h] is °/h, and 1 °/min is 60 °/h.

    >>> round(enough(72.0), 3)
    0.034
    """
    return bound * 60 * sqrt(seconds / 3600)


def section(found: Trials) -> Section:
    """Return the section of the printed accuracy."""
    return WORDS.section(
        (*_gyros(found), *_accelerometers(found)),
        (),
        (_chart(found),),
        seconds=SECONDS,
        bias=BIAS,
        walk=shown(enough(SECONDS)),
    )


def _gyros(found: Trials) -> list[Finding]:
    made = {name: score(found.gyros[name], "g") for name in (OWN, WHOLE, FULL)}
    own, whole, rest = made[OWN].worst, made[WHOLE].worst, score(found.gyros[REST], "g").bias
    share = {name: _share(found, name) for name in (OWN, WHOLE)}
    alone = shown(ARW / enough(SECONDS) * BIAS)
    reasons = {
        "bias": f"{share[OWN]} of the devices reach it on all three axes",
        "scale": f"{shown(own['scale'].value)} ppm",
        "misalignment": f"{shown(made[OWN].misalignment.value)}″ RMS of all six",
    }
    return [
        WORDS.judge("gyro_bias", *own["bias"], reasons["bias"]),
        WORDS.judge("at_rest", *rest,
            f"RMS of one axis; its white noise alone makes {alone} °/min, and "
            f"{shown(enough(SECONDS))} °/√h would do"),
        WORDS.judge("better", *whole["bias"],
            f"{share[WHOLE]} of the devices reach it on all three axes, with an RMS of one axis "
            f"of {shown(made[WHOLE].bias.value)} °/min"),
        *(
            WORDS.judge(f"gyro_{kind}", *_printed(own[kind], "g", kind), reasons[kind])
            for kind in KINDS if kind != "bias"
        ),
    ]  # fmt: skip


def _accelerometers(found: Trials) -> list[Finding]:
    made = score(found.accelerometers[HELD], "a")
    words = {
        "bias": f"{shown(made.worst['bias'].value)} µg",
        "scale": f"{shown(made.worst['scale'].value)} ppm",
        "misalignment": f"{shown(made.misalignment.value)}″ RMS of all six",
    }
    return [
        WORDS.judge(f"accelerometer_{kind}", *_printed(made.worst[kind], "a", kind), words[kind])
        for kind in KINDS
    ]


def _share(found: Trials, name: str) -> str:
    share = reached(found.gyros[name], places("bias"), BIAS)
    return f"{share:.0%}"


def _printed(one: Rms, of: str, kind: str) -> Rms:
    """Return a figure in the printed unit."""
    size = _PRINTED[of][kind]
    return Rms(one.value * size, one.u * size)


def _relative(one: Score, of: str) -> list[float]:
    bounds = [WORDS.claims[f"{_NAMES[of]}_{kind}"].expected for kind in KINDS]
    found = [_printed(one.worst[kind], of, kind).value for kind in KINDS]
    return [value / bound for value, bound in zip(found, bounds, strict=True)]


def _chart(found: Trials) -> Chart:
    held = {HELD: "18", "25 states": "25", "full": "full", BY_STEPS: "discrete"}
    panels = [
        Panel("", "", f"worst {_NAMES[of]}, over its bound",
              [_dots(score(runs[name], of), of, short, 0.08 * (k - 2))
               for k, (name, short) in enumerate(names.items())], names=tuple(KINDS))
        for of, runs, names in (
            ("g", found.gyros, _CHARTED), ("a", found.accelerometers, held)
        )
    ]  # fmt: skip
    return Chart(
        "methods",
        "Error of the worst axis, RMS over devices, over the bound in print: above 1 it is missed. "
        "Filters by their states; 19 once on the source's path and once on the whole recording. "
        "Scale factors and the accelerometers' bias are a hundred times better than in print.",
        panels,
    )


def _dots(one: Score, of: str, name: str, aside: float) -> Line:
    """Return the marks of one filter, a little aside: some agree."""
    return Line(name, np.arange(float(len(KINDS))) + aside, np.array(_relative(one, of)),
                joined=False)  # fmt: skip

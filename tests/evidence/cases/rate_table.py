"""Three accelerometers on a plain rate table, level and tilted, as in tests of ship models.

In the frame of the table (toward the centre, along the motion, up) the sensor senses the
centripetal acceleration and gravity's reaction; a mounting has its pose and its seat, a set speed
its own error, and at rest the table's axis leans from the vertical toward anywhere. Mountings are
those of `tests.accuracy.rate_table`.
"""

import numpy as np
from numpy.typing import NDArray
from tests.accuracy.rate_table import (
    PLANAR,
    RADIUS,
    RPM,
    TILTED,
    State,
    columns,
    rotation_from_vector,
)
from tests.evidence import sensor_models
from tests.evidence.csv_text import csv
from tests.evidence.sensor_models import PPM
from tests.evidence.visibility_model import G0, Case, Files, Unknown, Values, Violation

Array = NDArray[np.float64]
DEGREE = np.pi / 180
GRAVITY = 9.7936
POSE, SEAT, SPEED, LEAN = 0.2 * DEGREE, 0.5e-3, 0.05e-2, 0.05 * DEGREE
NOISE = 0.3e-3 * G0
_RUN = """\
[sensor]
name = "model"
[sensor.accelerometer]
unit = "LSB"
scale = "16384 LSB/g"
[bench]
kind = "rate_table"
gravity = "9.7936 m/s² ± 0.5 mm/s²"
radius = "250 mm ± 0.3 mm"
seat = "0.5 mm"
pose = "0.2 °"
speed = "0.05 %"
lean = "0.05 °"
[data]
kind = "means"
file = "states.csv"
mounting = "mounting"
arm_rate = "rpm"
accelerometer = ["ax", "ay", "az"]
[data.sd]
accelerometer = "0.3 mg"
[method]
"""


def _name(state: State) -> str:
    plane, tilt, second, _ = state
    text = plane + (f" {tilt:g}" if tilt else "")
    return text + (f" + {second:g}" if second is not None else "")


def _label(state: State) -> str:
    plane, tilt, second, rpm = state
    text = plane + (f"{tilt:g}" if tilt else "") + (f"{second:+g}" if second is not None else "")
    return f"{text} at {rpm:g} rpm"


def _case(method: str, states: tuple[State, ...], estimator: str = "") -> Case:
    n = len(states)
    mounted = list(dict.fromkeys(_name(s) for s in states))
    speeds = sorted({s[3] for s in states if s[3]})
    rests = [k for k, s in enumerate(states) if not s[3]]
    bare = [columns(p, t, s, "azimuth") for p, t, s, _ in states]
    place = np.linspace(-0.5, 0.5, n)

    def readings(v: Values) -> Array:
        g = GRAVITY + v.get("g", 0.0)
        f = np.empty((n, 3))
        for k, state in enumerate(states):
            m, rpm = _name(state), state[3]
            rate = rpm * RPM * (1 + v.get("rate", 0.0) + v.get(f"speed[{rpm:g}]", 0.0))
            a = (RADIUS + v.get("radius", 0.0) + v.get(f"seat[{m}]", 0.0)) * rate**2
            up = np.array([v.get(f"lean1[{k}]", 0.0), v.get(f"lean2[{k}]", 0.0), 1.0])
            up[0] += v.get("lean", 0.0) * (rpm == 0)
            force = g * up / np.linalg.norm(up)
            force[0] += a
            pose = rotation_from_vector(np.array([v.get(f"pose_{x}[{m}]", 0.0) for x in "xyz"]))
            f[k] = pose @ bare[k] @ force
        y = sensor_models.accelerometers(v, f, place)
        y[1, 0] += v.get("step", 0.0)
        return y.ravel()

    noise = np.full(3 * n, NOISE)

    def files(v: Values, rng: np.random.Generator, gross: Violation | None) -> Files:
        y = sensor_models.noisy_means(readings(v), noise, rng, gross, 3)
        rpm = sensor_models.typed_rates(v, np.array([s[3] for s in states]))
        names = ("mounting", "rpm", "ax", "ay", "az")
        table = csv(names, [_name(s) for s in states], rpm, 16384 * y / G0)
        text = _RUN + f'name = "{method}"\n'
        return {"run.toml": text + estimator, "states.csv": table}

    unknowns = sensor_models.triad(0.04 * G0, 0.02, 0.012)
    unknowns |= {"g": Unknown(0.5e-3), "radius": Unknown(0.3e-3)}
    unknowns |= {f"pose_{x}[{m}]": Unknown(POSE) for m in mounted for x in "xyz"}
    unknowns |= {f"seat[{m}]": Unknown(SEAT) for m in mounted}
    unknowns |= {f"speed[{w:g}]": Unknown(SPEED) for w in speeds}
    unknowns |= {f"lean{j}[{k}]": Unknown(LEAN) for k in rests for j in (1, 2)}
    first = mounted[0]
    of_speeds = tuple(f"speed[{w:g} rpm]" for w in speeds)
    violations = (
        Violation(
            "radius",
            "mm",
            1e-3,
            {"radius": 1.0},
            ("radius",),
            250,
            None,
            "state its ± in [bench] radius",
        ),
        Violation(
            "rate",
            "ppm",
            PPM,
            {"rate": 1.0},
            ("rate", *of_speeds),
            1e6,
            None,
            "state [bench] rate_error",
        ),
        Violation(
            "gravity",
            "ppm",
            GRAVITY * 1e-6,
            {"g": 1.0},
            ("g",),
            1e5,
            None,
            "state its ± in [bench] gravity",
        ),
        Violation(
            "pose of one mounting",
            "°",
            DEGREE,
            {f"pose_y[{first}]": 1.0},
            (f"pose_y[{first}]",),
            45,
            None,
            "[bench] pose",
        ),
        Violation(
            "seat of one mounting",
            "mm",
            1e-3,
            {f"seat[{first}]": 1.0},
            (f"seat[{first}]",),
            250,
            None,
            "[bench] seat",
        ),
        Violation(
            "tilt of the table's axis, alike at all rests",
            "°",
            DEGREE,
            {"lean": 1.0},
            ("lean", "lean_1"),
            45,
            None,
            "[bench] lean",
        ),
        Violation("one outlying state", "mg", 1e-3 * G0, {"step": 1.0}, (_label(states[1]),), 1e4),
        *sensor_models.accelerometer_violations("k2", "k3", "k1_prime", "kip", "kpo", "drift"),
        sensor_models.made_otherwise("one rate typed wrongly, by 10 %", typed=0.1),
        sensor_models.swap_columns(0, 1),
        sensor_models.reverse_axis(1),
        sensor_models.change_unit(1 / G0),
        sensor_models.shift_decimal(2),
        sensor_models.zero_channel(2),
        sensor_models.freeze_channel(2),
    )
    return Case(
        method,
        unknowns,
        readings,
        noise,
        violations,
        files,
        (n, 3),
        tuple(_label(s) for s in states),
        sensor_models.rival_coefficients("a"),
    )


def ship_planar() -> Case:
    """Return the nine level states."""
    return _case("ship_planar", PLANAR)


def ship_multi_angle() -> Case:
    """Return level and tilted states."""
    return _case("ship_multi_angle", PLANAR + TILTED)

"""Six positions, and six positions with three turns: the housing set down and turned by hand.

Up in the body is a face's normal turned by two small angles; a turn is about an axis of the body by
an angle, both with their errors, timed by the recording's clock. Of a turn the accelerometers' mean
is open: where gravity is then, nobody says.
"""

import numpy as np
from numpy.typing import NDArray
from tests.evidence import sensor_models
from tests.evidence.csv_text import csv
from tests.evidence.sensor_models import ARCSEC, DEG_H, PPM
from tests.evidence.visibility_model import G0, Case, Files, Unknown, Values, Violation

Array = NDArray[np.float64]
DEGREE = np.pi / 180
EARTH = 7.292115e-5  # rad/s, WGS 84
FACES = {a + s: k * np.eye(3)[i] for i, a in enumerate("xyz") for s, k in (("_p", 1), ("_a", -1))}
TURNS = {a + "_rot": np.eye(3)[i] for i, a in enumerate("xyz")}
GRAVITY, GRAVITY_SD = 9.81, 2e-4
LATITUDE = 47 * DEGREE
NOISE, TILT = 30e-6 * G0, 0.1 * DEGREE
SECONDS = 8.0
GYRO_NOISE = 5 * DEG_H


def tilted_axis(v: Values, name: str, label: str, axis: Array) -> Array:
    """Return an axis of the body turned by the two angles `name`1 and `name`2 of a label."""
    k = int(np.argmax(np.abs(axis)))
    off = axis.copy()
    off[(k + 1) % 3] += v.get(f"{name}1[{label}]", 0.0)
    off[(k + 2) % 3] += v.get(f"{name}2[{label}]", 0.0)
    return off / np.linalg.norm(off)


def rotated_up(v: Values, up: Array) -> Array:
    """Return `up` where the whole housing is turned by a common small rotation vector."""
    turn = np.array([v.get(f"seat_{a}", 0.0) for a in "xyz"])
    off = up - np.cross(turn, up)
    return off / np.linalg.norm(off)


def _forces(v: Values) -> Array:
    g = GRAVITY + v.get("g", 0.0)
    rows = [g * rotated_up(v, tilted_axis(v, "tilt", label, up)) for label, up in FACES.items()]
    return np.array(rows)


def typed_labels(v: Values, labels: list[str]) -> list[str]:
    """Return the labels as somebody typed them: the first and the third may be exchanged."""
    if v.get("exchanged", 0.0):
        labels = [labels[2], labels[1], labels[0], *labels[3:]]
    return labels


def _place(n: int) -> Array:
    return np.linspace(-0.5, 0.5, n)


def _tilts() -> dict[str, Unknown]:
    return {f"tilt{k}[{label}]": Unknown(TILT) for label in FACES for k in (1, 2)}


_INTO_SCALE = "state the ± of [bench] gravity; the error is common to all scale factors"
_INTO_TILT = "state [bench] tilt; the misalignments include a rotation of the whole housing"
BENCH = (
    Violation("gravity", "ppm", GRAVITY * 1e-6, {"g": 1.0}, ("g",), 5e4, None, _INTO_SCALE),
    Violation(
        "tilt of one face",
        "″",
        ARCSEC,
        {"tilt1[x_p]": 1.0},
        ("x_p",),
        36_000,
        None,
        "state [bench] tilt as large as the largest tilt of a face",
    ),
    Violation(
        "tilt common to all faces", "″", ARCSEC, {"seat_z": 1.0}, (), 36_000, None, _INTO_TILT
    ),
    Violation(
        "step in one rest",
        "mg",
        1e-3 * G0,
        {"step": 1.0},
        ("x_p",),
        1e3,
        None,
        "use the recording instead of its means; each rest is then tested against itself",
        limit="wrong readings",
    ),
)
_EXCHANGED = sensor_models.made_otherwise("two labels exchanged", exchanged=1.0)
GROSS = (
    _EXCHANGED,
    sensor_models.swap_columns(0, 1),
    sensor_models.reverse_axis(1),
    sensor_models.change_unit(1 / G0, slice(0, 3)),
    sensor_models.shift_decimal(2),
    sensor_models.zero_channel(2),
    sensor_models.freeze_channel(2),
)

_SIX = """\
[sensor]
name = "triad"
[sensor.accelerometer]
unit = "g"
[bench]
gravity = "9.81 m/s² ± 0.2 mm/s²"
tilt = "0.1 °"
[data]
file = "means.csv"
kind = "means"
label = "position"
accelerometer = ["ax", "ay", "az"]
[data.sd]
accelerometer = "30 µg"
[method]
name = "six_position"
"""


def six_position() -> Case:
    """Return six positions of three accelerometers, by their means."""

    def readings(v: Values) -> Array:
        y = sensor_models.accelerometers(v, _forces(v), _place(6))
        y[0, 0] += v.get("step", 0.0)
        return y.ravel()

    noise = np.full(18, NOISE)

    def files(v: Values, rng: np.random.Generator, gross: Violation | None) -> Files:
        y = sensor_models.noisy_means(readings(v), noise, rng, gross, 3)
        return {
            "run.toml": _SIX,
            "means.csv": csv(("position", "ax", "ay", "az"), typed_labels(v, [*FACES]), y / G0),
        }

    unknowns = sensor_models.triad(0.03 * G0, 0.01, 0.01)
    unknowns |= {"g": Unknown(GRAVITY_SD), **_tilts()}
    left_out = sensor_models.accelerometer_violations("k2", "k3", "k1_prime", "kip", "kpo", "drift")
    return Case(
        "six_position",
        unknowns,
        readings,
        noise,
        (*BENCH, *left_out, *GROSS),
        files,
        (6, 3),
        tuple(FACES),
        sensor_models.rival_coefficients("a"),
    )


_FERRARIS = """\
[sensor]
name = "IMU"
[sensor.accelerometer]
unit = "g"
[sensor.gyro]
unit = "°/s"
[bench]
gravity = "9.81 m/s² ± 0.2 mm/s²"
latitude = "47 °"
tilt = "0.1 °"
turn_angle = "0.1 °"
turn_tilt = "0.1 °"
timebase = "100 ppm"
[data]
file = "means.csv"
kind = "means"
label = "position"
seconds = "seconds"
accelerometer = ["ax", "ay", "az"]
gyro = ["gx", "gy", "gz"]
[data.sd]
accelerometer = "30 µg"
gyro = "5 °/h"
[method]
name = "ferraris"
"""


def ferraris() -> Case:
    """Return six positions and three turns of an IMU, by their means."""
    labels = [*FACES, *TURNS]
    n = len(labels)

    def readings(v: Values) -> Array:
        f, w = np.zeros((n, 3)), np.zeros((n, 3))
        f[:6] = _forces(v)
        g = GRAVITY + v.get("g", 0.0)
        phi = LATITUDE + v.get("latitude", 0.0)
        for k, (label, up) in enumerate(FACES.items()):
            level = np.zeros(3)
            i = int(np.argmax(np.abs(up)))
            level[(i + 1) % 3] = v.get(f"earth1[{label}]", 0.0)
            level[(i + 2) % 3] = v.get(f"earth2[{label}]", 0.0)
            w[k] = EARTH * np.sin(phi) * f[k] / g + level
        for k, (label, axis) in enumerate(TURNS.items(), start=6):
            about = tilted_axis(v, "axis", label, axis)
            f[k] = g * axis + [v.get(f"force_{a}[{label}]", 0.0) for a in "xyz"]
            angle = 2 * np.pi + v.get(f"angle[{label}]", 0.0)
            true_seconds = SECONDS * (1 + v.get("timebase", 0.0))
            w[k] = about * angle / true_seconds + EARTH * np.sin(phi) * f[k] / g
        place = _place(n)
        y = np.concatenate(
            [sensor_models.accelerometers(v, f, place), sensor_models.gyros(v, w, f, place)], axis=1
        )
        y[0, 0] += v.get("step", 0.0)
        y[0, 3] += v.get("gyro step", 0.0)
        return y.ravel()

    noise = np.tile(np.repeat([NOISE, GYRO_NOISE], 3), n)

    def files(v: Values, rng: np.random.Generator, gross: Violation | None) -> Files:
        y = sensor_models.noisy_means(readings(v), noise, rng, gross, 6)
        seconds = np.where(np.arange(n) < 6, 10.0, SECONDS)
        names = ("position", "seconds", "ax", "ay", "az", "gx", "gy", "gz")
        table = csv(names, typed_labels(v, labels), seconds, y[:, :3] / G0, y[:, 3:] / DEGREE)
        return {"run.toml": _FERRARIS, "means.csv": table}

    level = EARTH * np.cos(LATITUDE) / np.sqrt(2)  # the azimuth is anything
    unknowns = sensor_models.triad(0.03 * G0, 0.01, 0.01)
    unknowns |= sensor_models.gyro_triad(0.5 * DEGREE, 0.01, 0.01, 0.02 * DEGREE / G0)
    unknowns |= {"g": Unknown(GRAVITY_SD), "timebase": Unknown(1e-4), **_tilts()}
    unknowns |= {f"earth{k}[{label}]": Unknown(level) for label in FACES for k in (1, 2)}
    unknowns |= {f"angle[{label}]": Unknown(0.1 * DEGREE) for label in TURNS}
    unknowns |= {f"axis{k}[{label}]": Unknown(0.1 * DEGREE) for label in TURNS for k in (1, 2)}
    unknowns |= {f"force_{a}[{t}]": Unknown(0.1, "open") for t in TURNS for a in "xyz"}
    more = (
        Violation(
            "timebase",
            "ppm",
            PPM,
            {"timebase": 1.0},
            ("timebase",),
            1e5,
            None,
            "state [bench] timebase; the error is common to the gyros' scale factors",
        ),
        Violation(
            "angle of the turns",
            "°",
            DEGREE,
            {f"angle[{t}]": 1.0 for t in TURNS},
            (),
            360,
            None,
            "state [bench] turn_angle; only this angle determines the gyros' scale factors",
        ),
        Violation(
            "latitude",
            "°",
            DEGREE,
            {"latitude": 1.0},
            ("latitude", "earth_up"),
            90,
            None,
            "latitude left out of [bench]: the earth's rate is then unknown altogether",
        ),
        Violation(
            "step of a gyro in one rest",
            "°/h",
            DEG_H,
            {"gyro step": 1.0},
            ("x_p",),
            1e6,
            None,
            "use the recording instead of its means",
            limit="wrong readings",
        ),
    )
    accelerometers = sensor_models.accelerometer_violations("k2", "k3", "k1_prime", "drift")
    gyros = sensor_models.gyro_violations("scale_prime", "drift", "scale2")
    violations = (*BENCH, *more, *accelerometers, *gyros, *GROSS)
    return Case(
        "ferraris",
        unknowns,
        readings,
        noise,
        violations,
        files,
        (n, 6),
        tuple(labels),
        sensor_models.rival_coefficients("ag", "g_i", "g_p", "g_o"),
    )

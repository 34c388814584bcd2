"""Three gyros on a rate table with a vertical axis, each case axis up in a setting of its own.

In a setting the table's axis is off by two angles, alike in all its rows; the rate has a common
error, and the level part of the earth's rate, of unknown azimuth, is sensed at rest alone because
the table turns whole turns otherwise. The gyros stay switched on.
"""

import numpy as np
from numpy.typing import NDArray
from tests.evidence import sensor_models
from tests.evidence.csv_text import csv
from tests.evidence.sensor_models import DEG_H, PPM
from tests.evidence.visibility_model import G0, Case, Files, Unknown, Values, Violation

Array = NDArray[np.float64]
DEGREE = np.pi / 180
EARTH = 7.292115e-5  # rad/s, WGS 84
LATITUDE = 50 * DEGREE
SETTING, RATE, NOISE = 0.02 * DEGREE, 1e-4, 0.7 * DEG_H
SECONDS = 36.0
SPEEDS = (0.0, 20.0, 50.0, 100.0)  # °/s
_RUN = """\
[sensor]
name = "gyros"
[sensor.gyro]
unit = "°/s"
[bench]
kind = "rate_platform"
latitude = "50 °"
rate_scale = "100 ppm"
rate_asymmetry = "0 ppm"
rate_stability = "0 ppm"
setting = "0.02 °"
[data]
kind = "means"
file = "rates.csv"
axis = "axis"
table_rate = "rate"
seconds = "seconds"
gyro = ["gx", "gy", "gz"]
[data.sd]
gyro = "0.7 °/h"
[method]
name = "rates_and_poses"
"""


def rates_and_poses() -> Case:
    """Return rests and rates of both senses, up and down again, in three settings."""
    one_sense = [*SPEEDS, *SPEEDS[::-1]]
    rates = np.array([*one_sense, *(-r for r in one_sense if r)] * 3)
    setting = np.repeat(np.arange(3), len(rates) // 3)
    n = len(rates)

    def readings(v: Values) -> Array:
        phi = LATITUDE + v.get("latitude", 0.0)
        w, f = np.zeros((n, 3)), np.zeros((n, 3))
        for k in range(n):
            i, place = int(setting[k]), "xyz"[setting[k]]
            tilt = [v.get(f"setting{j}[{place}]", 0.0) for j in (1, 2)]
            axis = np.zeros(3)
            axis[[i, (i + 1) % 3, (i + 2) % 3]] = 1.0, *tilt
            axis /= np.linalg.norm(axis)
            along = rates[k] * DEGREE * (1 + v.get("rate", 0.0)) + EARTH * np.sin(phi)
            w[k] = along * axis
            f[k] = G0 * axis
            if rates[k] == 0:
                for j in (1, 2):
                    w[k, (i + j) % 3] += v.get(f"earth{j}[{place}]", 0.0)
                    w[k, i] -= tilt[j - 1] * v.get(f"earth{j}[{place}]", 0.0)
        y = sensor_models.gyros(v, w, f, np.linspace(-0.5, 0.5, n))
        for a in range(3):
            y[setting == 1, a] += v.get(f"turn_on_{'xyz'[a]}", 0.0)
            cubic = v.get("scale3", 0.0) + v.get(f"g{'xyz'[a]}.scale3", 0.0)
            y[:, a] += cubic * w[:, a] ** 3
        y[2, 0] += v.get("step", 0.0)
        return y.ravel()

    noise = np.full(3 * n, NOISE)

    def files(v: Values, rng: np.random.Generator, gross: Violation | None) -> Files:
        y = sensor_models.noisy_means(readings(v), noise, rng, gross, 3)
        axes = ["xyz"[k] for k in setting]
        names = ("axis", "rate", "seconds", "gx", "gy", "gz")
        table = csv(
            names, axes, sensor_models.typed_rates(v, rates), np.full(n, SECONDS), y / DEGREE
        )
        return {"run.toml": _RUN, "rates.csv": table}

    level = EARTH * np.cos(LATITUDE) / np.sqrt(2)
    unknowns = sensor_models.gyro_triad(0.02 * DEGREE, 0.003, 0.003)
    unknowns |= {f"setting{j}[{a}]": Unknown(SETTING) for a in "xyz" for j in (1, 2)}
    unknowns |= {f"earth{j}[{a}]": Unknown(level) for a in "xyz" for j in (1, 2)}
    unknowns |= {"rate": Unknown(RATE)}
    switched = {"turn_on_x": 1.0, "turn_on_y": -0.7, "turn_on_z": 0.8}
    labels = ("turn_on", "turn_on[y]", *(f"turn_on_{a}[y]" for a in "xyz"))
    along = {f"g{a}.g_i": 1.0 for a in "xyz"}
    violations = (
        Violation(
            "bias of another turn-on in one setting",
            "°/h",
            DEG_H,
            switched,
            labels,
            1e6,
            None,
            "[bench] turn_on",
        ),
        Violation(
            "latitude",
            "°",
            DEGREE,
            {"latitude": 1.0},
            ("latitude",),
            90,
            None,
            "the latitude of the place: its error is common to the biases",
            limit="latitude",
        ),
        Violation(
            "rate of the table",
            "ppm",
            PPM,
            {"rate": 1.0},
            ("rate_scale",),
            1e4,
            None,
            "state [bench] rate_scale; the error is common to all scale factors",
        ),
        Violation(
            "sensitivity of the gyros to acceleration",
            "°/h/g",
            DEG_H / G0,
            along,
            ("g", "g_i", *along),
            1e6,
            None,
            'also = ["g"], with each axis up and down',
            limit="g",
        ),
        Violation(
            "third-order nonlinearity of the gyros",
            "ppm/(rad/s)²",
            PPM,
            {"scale3": 1.0},
            ("scale3", *(f"g{a}.scale3" for a in "xyz")),
            1e6,
            None,
            'also = ["scale3"]',
        ),
        *sensor_models.gyro_violations("scale_prime", "drift", "scale2"),
        Violation("one outlying section", "°/h", DEG_H, {"step": 1.0}, ("x +50 °/s",), 1e6),
        sensor_models.made_otherwise("one rate typed wrongly, by 10 %", typed=0.1),
        sensor_models.swap_columns(0, 1),
        sensor_models.reverse_axis(1),
        sensor_models.change_unit(np.pi / 180),
        sensor_models.zero_channel(2),
    )
    return Case("rates_and_poses", unknowns, readings, noise, violations, files, (n, 3))

"""Three accelerometers on a centrifuge, by the norms of what they sense.

On the arm the centripetal acceleration points inwards and gravity's reaction up; gravity leans by a
constant tilt along the arm. Where the sensor points at each dwell is open: norms know no attitude.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from tests.accuracy.centrifuge import full_circle
from tests.evidence import sensor_models
from tests.evidence.csv_text import csv
from tests.evidence.sensor_models import ARCSEC, PPM, UG
from tests.evidence.visibility_model import G0, Case, Files, Unknown, Values, Violation

Array = NDArray[np.float64]
DEGREE = np.pi / 180
EARTH = 7.292115e-5  # rad/s, WGS 84
GRAVITY, RADIUS, LATITUDE = 9.80123, 1.0, 39 * DEGREE
_ALSO = {name: f'also = ["{name}"]' for name in ("k3", "koq")} | {
    "delta_o": 'also = ["nonorthogonality"]'
}
RPM = (60.0, 120.0, 180.0)
NOISE = 10e-6 * G0
_RUN = """\
[sensor]
name = "triad"
[sensor.accelerometer]
unit = "V"
scale = "0.1 V/g"
[bench]
kind = "centrifuge"
gravity = "9.80123 m/s² ± 0.1 mm/s²"
latitude = "39 ° ± 0.1 °"
radius = "1 m ± 10 µm"
rate_error = "1 ppm"
tilt = "2 ″"
dwell_rate = "0.2 ppm"
[data]
kind = "means"
file = "dwells.csv"
label = "position"
accelerometer = ["ax", "ay", "az"]
arm_rate = "rpm"
[data.sd]
accelerometer = "1 µV"
[method]
name = "centrifuge_norm"
"""


def centrifuge_norm() -> Case:
    """Return twenty attitudes at three rates."""
    dwells = [(rpm, *attitude) for rpm in RPM for attitude in full_circle()]
    n = len(dwells)

    def readings(v: Values) -> Array:
        g = GRAVITY + v.get("g", 0.0)
        radius = RADIUS + v.get("radius", 0.0)
        earth = EARTH * np.sin(LATITUDE + v.get("latitude", 0.0))
        forces = np.empty((n, 3))
        for k, (rpm, psi, theta) in enumerate(dwells):
            own = 1 + v.get("rate", 0.0) + v.get(f"dwell_rate[{k}]", 0.0)
            a = (rpm * np.pi / 30 * own + earth) ** 2 * radius
            a = a * (1 + v.get("stretch", 0.0) * a)
            a = a + g * v.get("tilt", 0.0)
            out = np.array([np.cos(psi) * np.cos(theta), np.sin(psi), np.cos(psi) * np.sin(theta)])
            up = np.array([np.sin(theta), 0.0, -np.cos(theta)])
            f = g * up - a * out
            along = np.cross(up, out)
            across = np.cross(f / np.linalg.norm(f), along)
            f = f + np.linalg.norm(f) * (
                v.get(f"aim1[{k}]", 0.0) * along + v.get(f"aim2[{k}]", 0.0) * across
            )
            aimed = np.linalg.norm(g * up - a * out)
            forces[k] = f * aimed / np.linalg.norm(f)
            # The sensor's axes sit beside its centre: a lever arm of x along x.
            forces[k, 0] -= v.get("ax.arm_i", 0.0) * (rpm * np.pi / 30) ** 2 * (1 - up[0] ** 2)
        y = sensor_models.accelerometers(v, forces, np.linspace(-0.5, 0.5, n))
        y[0, 0] += v.get("step", 0.0)
        return y.ravel()

    noise = np.full(3 * n, NOISE)

    def files(v: Values, rng: np.random.Generator, gross: Violation | None) -> Files:
        y = sensor_models.noisy_means(readings(v), noise, rng, gross, 3)
        labels = [f"p{k + 1:02d}" for k in range(n)]
        rpm = sensor_models.typed_rates(v, np.array([dwell[0] for dwell in dwells]))
        table = csv(("position", "rpm", "ax", "ay", "az"), labels, rpm, 0.1 * y / G0)
        return {"run.toml": _RUN, "dwells.csv": table}

    sizes = {"k0": 5e-3 * G0, "k1": 2e-3, "k2": 50 * UG / G0**2}
    unknowns = {f"a{a}.{c}": Unknown(sd, "coefficient") for a in "xyz" for c, sd in sizes.items()}
    unknowns |= {
        "g": Unknown(1e-4),
        "radius": Unknown(10e-6),
        "rate": Unknown(1e-6),
        "tilt": Unknown(2 * ARCSEC),
        "latitude": Unknown(0.1 * DEGREE),
    }
    unknowns |= {f"dwell_rate[{k}]": Unknown(0.2e-6) for k in range(n)}
    unknowns |= {f"aim{j}[{k}]": Unknown(1e-3, "open") for k in range(n) for j in (1, 2)}
    stated = "state its ± in [bench]"
    rows = tuple(f"p{k + 1:02d} at {dwell[0]:g} rpm" for k, dwell in enumerate(dwells))
    violations = (
        Violation(
            "radius", "µm", 1e-6, {"radius": 1.0}, ("radius",), 1e5, None, f"{stated} radius"
        ),
        Violation(
            "rate", "ppm", PPM, {"rate": 1.0}, ("rate",), 1e5, None, "state [bench] rate_error"
        ),
        Violation(
            "gravity", "ppm", GRAVITY * 1e-6, {"g": 1.0}, ("g",), 5e4, None, f"{stated} gravity"
        ),
        Violation("tilt", "″", ARCSEC, {"tilt": 1.0}, ("tilt",), 36_000, None, "[bench] tilt"),
        Violation(
            "latitude",
            "°",
            DEGREE,
            {"latitude": 1.0},
            ("latitude",),
            90,
            None,
            f"{stated} latitude",
        ),
        Violation(
            "stretch of the arm",
            "ppm/g",
            PPM / G0,
            {"stretch": 1.0},
            ("stretch",),
            1e4,
            None,
            f"{stated} stretch",
        ),
        Violation(
            "lever arm of one axis",
            "mm",
            1e-3,
            {"ax.arm_i": 1.0},
            ("arm_i", "ax.arm_i"),
            1e3,
            None,
            'estimate it with also = ["ax.arm_i"] and [data] attitude',
            limit="lever arms",
        ),
        Violation("one outlying dwell", "mg", 1e-3 * G0, {"step": 1.0}, ("p01 at 60 rpm",), 1e4),
        *sensor_models.accelerometer_violations(
            "k3", "koq", "k1_prime", "delta_o", "drift", counted=_ALSO
        ),
        # A norm is that of the mirrored force as well: attitudes are not known.
        sensor_models.made_otherwise("one rate typed wrongly, by 1 %", typed=0.01),
        replace(sensor_models.swap_columns(0, 1), symmetric=True),
        replace(sensor_models.reverse_axis(1), symmetric=True),
        sensor_models.change_unit(1 / G0),
        sensor_models.shift_decimal(2),
        sensor_models.zero_channel(2),
        sensor_models.freeze_channel(2),
    )
    return Case(
        "centrifuge_norm",
        unknowns,
        readings,
        noise,
        violations,
        files,
        (n, 3),
        rows,
        sensor_models.rival_coefficients("a", "k2"),
    )

"""One accelerometer, or two at right angles, on a dividing head with its spindle level.

Gravity's reaction turns through the plane of rotation with the true angle: the head's, harmonics
and graduations, and where an autocollimator is used its own, the zero of the head and the base's
tilts. The readings are those of `tests.accuracy.dividing_head`.
"""

import numpy as np
from numpy.typing import NDArray
from tests.accuracy import dividing_head
from tests.evidence import sensor_models
from tests.evidence.csv_text import csv
from tests.evidence.sensor_models import ARCSEC, UG
from tests.evidence.visibility_model import G0, Case, Files, Unknown, Values, Violation

Array = NDArray[np.float64]
GRAVITY = 9.80123
N = 12
SI = {"k0": G0, "k1": 1.0, "delta_o": 1.0, "k2": 1 / G0, "k3": 1 / G0**2, "kip": 1 / G0}
SIZES = {
    "k0": 300 * UG, "k1": 200e-6, "delta_o": 100 * ARCSEC,
    "k2": 10e-6 / G0, "k3": 5e-6 / G0**2, "kip": 20e-6 / G0,
}  # fmt: skip
_BENCH = """\
[bench]
kind = "dividing_head"
gravity = "9.80123 m/s² ± 5 µm/s²"
harmonics = ["{h1} ″", "{h2} ″"]
division = "{division} ″"
autocollimation = "{collimation}"
base = "5 ″"
pier = "0.02 ″"
creep = "0 ″"
lean = "10 ″"
drift = "1 µg"
"""
_DATA = """\
[data]
kind = "means"
file = "head.csv"
accelerometer = [{columns}]
angle = "angle"
[data.sd]
accelerometer = "{noise} µg"
"""
_PAIR_PRIORS = """\
[method.prior]
"a.kip" = "0 ± 20 µg/g²"
"b.kip" = "0 ± 20 µg/g²"
"a.k3" = "0 ± 5 µg/g³"
"b.k3" = "0 ± 5 µg/g³"
"""


def _case(
    method: str, axes: str, h1: float, h2: float, division: float, noise_ug: float, *, pairs: bool
) -> Case:
    theta = dividing_head.angles(N, reverse=True)
    rows, m = theta.size, len(axes)
    passes = dividing_head.ramps(rows, N)
    graduation = np.concatenate([np.arange(N), np.arange(N)[::-1]])
    names = [f"{n}{h}" for h in (1, 2) for n in ("sin", "cos")]
    run = np.linspace(-0.5, 0.5, rows)

    def true_angle(v: Values) -> Array:
        head = sum(
            (v.get(f"sin{h}", 0.0) * np.sin(h * theta) + v.get(f"cos{h}", 0.0) * np.cos(h * theta))
            for h in (1, 2, 3)
        )
        head = head + np.array([v.get(f"division[{k}]", 0.0) for k in graduation])
        if pairs:  # 180° is brought to what the autocollimator read at 0°, 270° to that of 90°
            for start in range(0, rows, N):
                at = {int(graduation[k]): k for k in range(start, start + N)}
                for first in (0, N // 4):
                    one, other = at[first], at[first + N // 2]
                    head[other] = head[one] + v.get(f"trim[{other}]", 0.0)
        pier = np.array([v.get(f"pier[{k}]", 0.0) for k in range(rows)])
        creep = np.array([v.get(f"creep[{k}]", 0.0) for k in range(len(passes))]) @ passes
        return np.asarray(theta + head + pier + creep + v.get("base", 0.0), dtype=float)

    def readings(v: Values) -> Array:
        psi = true_angle(v)
        g = (GRAVITY + v.get("g", 0.0)) / G0 * np.cos(v.get("lean", 0.0))
        y = np.empty((rows, m))
        for k, axis in enumerate(axes):
            c = {n: v.get(f"{axis}.{n}", 0.0) / si for n, si in SI.items()}
            at = psi + k * np.pi / 2 + c["delta_o"]
            a, p = g * np.sin(at), g * np.cos(at)
            y[:, k] = (
                c["k0"] + (1 + c["k1"]) * a + c["k2"] * a**2 + c["k3"] * a**3 + c["kip"] * a * p
            )
            y[:, k] += v.get(f"{axis}.koq", 0.0) * G0 * a * np.abs(a)
            y[:, k] += 0.5 * v.get(f"{axis}.k1_prime", 0.0) * np.abs(a)
            y[:, k] += v.get(f"{axis}.kpp", 0.0) * G0 * p**2
            wave = np.array([v.get(f"drift_{axis}[{j}]", 0.0) for j in range(len(passes))]) @ passes
            y[:, k] += (wave + v.get(f"{axis}.drift", 0.0) * run) / G0
            y[:, k] += v.get("hysteresis", 0.0) / G0 * np.where(np.arange(rows) < N, 0.5, -0.5)
        y[0, 0] += v.get("step", 0.0) / G0
        return np.asarray(G0 * y, dtype=float).ravel()

    noise = np.full(rows * m, noise_ug * UG)

    def files(v: Values, rng: np.random.Generator, gross: Violation | None) -> Files:
        y = sensor_models.noisy_means(readings(v), noise, rng, gross, m)
        text = '[sensor]\nname = "pair"\n[sensor.accelerometer]\nunit = "V"\nscale = "3 V/g"\n'
        collimation = "pairs" if pairs else "none"
        text += _BENCH.format(h1=h1, h2=h2, division=division, collimation=collimation)
        text += 'autocollimator = "0.1 ″"\ncertificate = "0 ″"\n' * pairs
        columns = ", ".join(f'"{axis}"' for axis in axes)
        text += _DATA.format(columns=columns, noise=noise_ug)
        text += f'[method]\nname = "{method}"\n' + (_PAIR_PRIORS if m > 1 else "")
        typed = np.degrees(theta) + v.get("typed", 0.0) * (np.arange(rows) == 2)
        table = csv(("angle", *axes), typed, 3 * y / G0)
        return {"run.toml": text, "head.csv": table}

    known = {"k3", "kip"} if m > 1 else set[str]()
    unknowns = {
        f"{axis}.{n}": Unknown(sd, "coefficient", n in known)
        for axis in axes
        for n, sd in SIZES.items()
    }
    unknowns |= dict(zip(names, (Unknown(h * ARCSEC) for h in (h1, h1, h2, h2)), strict=True))
    unknowns |= {
        "g": Unknown(5e-6),
        "base": Unknown(5 * ARCSEC),
        "lean": Unknown(10 * ARCSEC),
    }
    unknowns |= {f"division[{k}]": Unknown(division * ARCSEC) for k in range(N)}
    unknowns |= {f"pier[{k}]": Unknown(0.02 * ARCSEC) for k in range(rows)}
    if pairs:
        trimmed = [k for k in range(rows) if graduation[k] in (N // 2, 3 * N // 4)]
        unknowns |= {f"trim[{k}]": Unknown(np.sqrt(2) * 0.1 * ARCSEC) for k in trimmed}
    unknowns |= {f"drift_{axis}[{j}]": Unknown(1 * UG) for axis in axes for j in range(len(passes))}
    both = dict.fromkeys(axes, 1.0)
    prior = "state [method.prior] of k3 as wide as k3 may be"

    def sensor(
        name: str, words: str, unit: str, si: float, counted: str = sensor_models.NO_KEY
    ) -> Violation:
        change = {f"{axis}.{name}": size for axis, size in both.items()}
        suspects = (name, *change)
        limit = name if counted == sensor_models.NO_KEY else ""
        if counted == prior:
            suspects += tuple(f"prior of {one}" for one in suspects)
        return Violation(words, unit, si, change, suspects, 1e5, None, counted, limit=limit)

    angles = [f"{round(np.degrees(a))}°" for a in theta]
    ways = ["forward" if k < N else "reverse" for k in range(rows)]
    labels = tuple(f"{a} {way}" for a, way in zip(angles, ways, strict=True))
    rivals = {n: tuple(f"{axis}.{n}" for axis in axes) for n in ("koq", "k1_prime", "kpp")}
    violations = (
        Violation(
            "first harmonic of the head",
            "″",
            ARCSEC,
            {"sin1": 1.0},
            ("sin1",),
            3600,
            None,
            "state [bench] harmonics",
        ),
        Violation(
            "second harmonic of the head",
            "″",
            ARCSEC,
            {"sin2": 1.0},
            ("sin2",),
            3600,
            None,
            "state [bench] harmonics",
        ),
        Violation(
            "third harmonic of the head",
            "″",
            ARCSEC,
            {"sin3": 1.0},
            ("sin3",),
            3600,
            None,
            "[bench] harmonics, a third",
        ),
        Violation(
            "zero of the head (base tilt)",
            "″",
            ARCSEC,
            {"base": 1.0},
            ("base",),
            36_000,
            None,
            "state [bench] base",
        ),
        Violation(
            "creep of the base in one pass",
            "″",
            ARCSEC,
            {"creep[0]": 1.0},
            ("creep[pass 1]",),
            3600,
            None,
            "[bench] creep",
        ),
        Violation(
            "gravity",
            "ppm",
            GRAVITY * 1e-6,
            {"g": 1.0},
            ("g",),
            5e4,
            None,
            "state its ± in [bench] gravity",
        ),
        Violation(
            "drift over the run",
            "µg",
            UG,
            {f"{axis}.drift": 1.0 for axis in axes},
            (
                "drift of accelerometers",
                *(f"drift of {a}" for a in axes),
                *(f"drift_{a}[pass {j}]" for a in axes for j in (1, 2)),
            ),
            1e5,
            None,
            "[bench] drift",
        ),
        Violation("one outlying position", "µg", UG, {"step": 1.0}, ("f01", "0° forward"), 1e6),
        sensor("k1_prime", "asymmetry of the scale factor", "ppm", 1e-6),
        sensor("kpp", "cross-axis nonlinearity K_pp", "µg/g²", UG / G0**2),
        sensor("koq", "odd quadratic nonlinearity", "µg/g²", UG / G0**2),
        *(
            (
                sensor(
                    "k3", "third-order nonlinearity k3 beyond its prior", "µg/g³", UG / G0**3, prior
                ),
            )
            if m > 1
            else ()
        ),
        sensor_models.made_otherwise("hysteresis, 10 µg", hysteresis=10 * UG),
        sensor_models.made_otherwise("one attitude typed wrongly, by 10°", typed=10.0),
        *((sensor_models.swap_columns(0, 1),) if m > 1 else ()),
        sensor_models.reverse_axis(m - 1),
        sensor_models.change_unit(1 / G0),
        sensor_models.shift_decimal(2),
        sensor_models.zero_channel(m - 1),
        sensor_models.freeze_channel(m - 1),
    )
    return Case(method, unknowns, readings, noise, violations, files, (rows, m), labels, rivals)


def dual_orthogonal() -> Case:
    """Return two accelerometers on an ordinary head with an autocollimator in four positions."""
    return _case("dual_orthogonal", "ab", 1.9, 1.6, 1.6, 0.2, pairs=True)


def tumble() -> Case:
    """Return one accelerometer on a good head."""
    return _case("tumble", "a", 0.5, 0.4, 0.3, 0.5, pairs=False)

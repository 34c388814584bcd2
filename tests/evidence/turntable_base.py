"""Turntables of which all is as stated: NEES, p-values and false alarms, method by method.

`python -m tests.evidence.turntable_base` works out 600 devices per method and writes
`turntable-base.md`; with fewer devices or some methods the table is printed and not written.

Each device has a random path and is calibrated through its files: random attitudes and turns at
random rates, with limited jerk, gyros of .02 or .1 °/√h, sampled at 50, 100 or 200 Hz. The motion,
the readings and their noise are those of `tests.evidence.cases.turntable`, which knows nothing of
inercal; all errors of sensor and table are drawn as they are stated.
"""

import argparse
import sys
import tempfile
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from math import radians, sqrt
from multiprocessing import Pool, cpu_count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from tests.accuracy.turntable import Stand, Table, Turn, simulate_travel
from tests.evidence import sensor_models
from tests.evidence.cases import turntable as case
from tests.evidence.cases.hand_recordings import npz_archive
from tests.evidence.graded_calibration import suspect_names
from tests.evidence.sensor_models import ARCSEC, DEG_H
from tests.evidence.stored_counts import FOLDER, current_commit, describe_machine
from tests.evidence.visibility_model import G0, Files, Unknown, Values

from inercal.pipeline import calibrate

Array = NDArray[np.float64]
PAGE = FOLDER / "turntable-base.md"
METHODS = ("turntable_discrete", "turntable_kalman", "turntable_trajectory")
DEVICES, BATCH = 600, 5  # of each method
RATES = (50.0, 100.0, 200.0)  # Hz
# White noise of gyros, °/√h, and of accelerometers, µg/√Hz; bias instability, °/h and µg
GRADES = {"good": (0.02, 20.0, 0.1, 5.0), "tactical": (0.1, 60.0, 0.5, 15.0)}
_PAGE = """\
# Turntable: devices that are as stated

Written by `make evidence`; do not edit. The devices follow random paths, have gyros of .02 and .1
°/√h, and are sampled at 50 to 200 Hz. Each device is calibrated through its files. NEES is the mean
of (error)ᵀ covariance⁻¹ (error) over the number of coefficients. The column "chance" is three
standard deviations of the scatter of NEES by chance. "Uniform p" is the p-value of a
Kolmogorov–Smirnov test of whether the p-values of χ² are uniformly distributed. For filters, the
p-values of each filter are tested too. False alarms are verdicts other than "consistent".

{table}

Commit {commit}; {machine}.
"""


@dataclass(frozen=True)
class BaseDevice:
    """What inercal said of one device.

    Parameters
    ----------
    nees : float
    p_values : tuple of float
        Of χ² of the estimate, and of each group of its residuals.
    grade : str
    suspect : str
    """

    nees: float
    p_values: tuple[float, ...]
    grade: str
    suspect: str


def random_path(rng: np.random.Generator, method: str) -> case.Path:
    """Return attitudes and turns in random order, at random angles and rates, °."""

    def anywhere() -> tuple[float, float, float]:
        outer, middle, inner = rng.uniform(-180, 180, 3).round(3).tolist()
        return outer, middle, inner

    path: list[Stand | Turn] = [("warm-up", (0, 0, 0), 30.0)]
    if method == "turntable_discrete":
        for k, angles in enumerate(case.SIX.values()):
            # Near the six positions: one sense of each axis upwards, so that all is observed.
            tilted = (np.array(angles) + rng.uniform(-20, 20, 3)).round(3).tolist()
            path.append((f"p{k}", (tilted[0], tilted[1], tilted[2]), 20.0))
            rate = round(rng.uniform(20, 30), 3)
            path += [(f"t{k}+", 0, 360.0, rate), (f"t{k}-", 0, -360.0, rate)]
        return path
    path += [(f"p{k}", anywhere(), 10.0) for k in range(12)]
    for k, axis in enumerate(rng.permutation([0, 0, 1, 1, 2, 2]).tolist()):
        angle = float(round(rng.choice([-1, 1]) * rng.uniform(240, 720), 3))
        path.append((f"t{k}+", axis, angle, round(rng.uniform(10, 30), 3)))
        path.append((f"q{k}", anywhere(), 5.0))
    return path


def device_files(rng: np.random.Generator, method: str, k: int) -> tuple[Files, Values]:
    """Return the files of the k-th device's run, and the true coefficients, SI."""
    arw, vrw, gyro, force = GRADES[("good", "tactical")[k % 2]]
    hz, path = RATES[k // 2 % len(RATES)], random_path(rng, method)
    unknowns = sensor_models.triad(10e-3 * G0, 5e-3, 15 / 60 * case.DEGREE)
    unknowns |= sensor_models.gyro_triad(0.3 * case.DEGREE, 5e-3, 15 / 60 * case.DEGREE)
    coefficients = tuple(unknowns)
    unknowns |= {
        "g": Unknown(case.GRAVITY_SD),
        "lean_x": Unknown(5 * ARCSEC),
        "lean_y": Unknown(5 * ARCSEC),
        "azimuth": Unknown(0.1 * case.DEGREE),
        "square_1": Unknown(2 * ARCSEC),
        "square_2": Unknown(2 * ARCSEC),
        "latency": Unknown(5e-3),
    }
    unknowns |= {
        f"{wave}{h}[{name}]": Unknown(size)
        for name in case.NAMES
        for h, size in case.HARMONICS
        for wave in ("sin", "cos")
    }
    v = {name: one.sd * float(rng.standard_normal()) for name, one in unknowns.items()}
    table = Table(
        latency=v["latency"], jerk=case.JERK, acceleration=radians(float(rng.uniform(20, 40)))
    )
    true, speed, late, steps = simulate_travel(path, table, hz)
    n = len(true)
    y = case.noise_free_readings(v, true, speed)
    for part, white, size in (
        (slice(0, 3), vrw * 1e-6 * G0, force * 1e-6 * G0),
        (slice(3, 6), arw * case.DEGREE / 60, gyro * DEG_H),
    ):
        y[:, part] += white * sqrt(hz) * rng.standard_normal((n, 3))
        y[:, part] += case.flicker(rng, n, hz, size)
    said = case.readback(v, late) + 0.5 * ARCSEC * rng.standard_normal((n, 3))
    columns = {f"a{x}": y[:, k] / G0 for k, x in enumerate("xyz")}
    columns |= {f"g{x}": y[:, 3 + k] / case.DEGREE for k, x in enumerate("xyz")}
    columns |= {name: said[:, k] / case.DEGREE for k, name in enumerate(case.NAMES)}
    text = case.run_text(method, f"{arw} °/√h", f"{vrw} µg/√Hz", f"{gyro} °/h", f"{force} µg")
    files: Files = {
        "run.toml": text,
        "path.csv": case.path_text(path),
        "log.npz": npz_archive(time=np.arange(n) / hz, step=steps, **columns),
    }
    return files, {name: v[name] for name in coefficients}


def calibrate_device(method: str, k: int) -> BaseDevice:
    """Return what inercal says of the k-th device of a method."""
    rng = np.random.default_rng([k, METHODS.index(method), 4716])
    files, truth = device_files(rng, method, k)
    with tempfile.TemporaryDirectory() as folder:
        for name, content in files.items():
            raw = content.encode() if isinstance(content, str) else content
            (Path(folder) / name).write_bytes(raw)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            outcome = calibrate(Path(folder) / "run.toml")
    found, estimate = outcome.calibration, outcome.estimate
    names = found.sensor.coefficients
    off = found.values - np.array([truth.get(name, 0.0) for name in names])
    nees = float(off @ np.linalg.solve(found.covariance, off)) / len(names)
    p = [float(estimate.p_value), *(float(one.p_value) for one in estimate.groups)]
    return BaseDevice(nees, tuple(p), outcome.verdict.grade, "".join(suspect_names(outcome)[0][:1]))


def _task(task: tuple[str, int, int]) -> list[BaseDevice]:
    method, first, count = task
    return [calibrate_device(method, k) for k in range(first, first + count)]


def compute_devices(
    methods: Sequence[str], devices: int, processes: int
) -> dict[str, list[BaseDevice]]:
    """Return the devices of each method, worked out side by side."""
    tasks = [
        (method, first, min(BATCH, devices - first))
        for method in methods
        for first in range(0, devices, BATCH)
    ]
    found: dict[str, list[BaseDevice]] = {method: [] for method in methods}
    with Pool(processes) as pool:
        for task, some in zip(tasks, pool.imap(_task, tasks), strict=True):
            found[task[0]] += some
    return found


def uniformity(devices: Sequence[BaseDevice]) -> list[float]:
    """Return the p-values of Kolmogorov and Smirnov, of χ² and of each group of residuals."""
    columns = zip(*(one.p_values for one in devices), strict=True)
    return [float(stats.kstest(list(one), "uniform").pvalue) for one in columns]


def table_text(found: dict[str, list[BaseDevice]]) -> str:
    """Return the methods as a table; odd devices are tactical, even ones good."""
    lines = [
        "| method | devices | NEES | good | tactical | chance | uniform p | false alarms |",
        "|" + "---|" * 8,
    ]
    for method, devices in found.items():
        nees = np.array([one.nees for one in devices])
        alarms = [one for one in devices if one.grade != "consistent"]
        tests = ", ".join(f"{p:.3f}" for p in uniformity(devices))
        lines.append(
            f"| {method} | {len(devices)} | {nees.mean():.3f} | {nees[::2].mean():.3f} "
            f"| {nees[1::2].mean():.3f} | ± {3 * sqrt(2 / (24 * len(devices))):.3f} | {tests} "
            f"| {len(alarms)} ({100 * len(alarms) / len(devices):.1f} %) |"
        )
    return "\n".join(lines)


def main(arguments: list[str]) -> None:
    """Work out the devices, and write or print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.evidence.turntable_base")
    parser.add_argument("--methods", nargs="*", default=list(METHODS), choices=METHODS)
    parser.add_argument("--devices", type=int, default=DEVICES, help="of each method")
    parser.add_argument("--processes", type=int, default=cpu_count())
    chosen = parser.parse_args(arguments)
    found = compute_devices(chosen.methods, chosen.devices, chosen.processes)
    table = table_text(found)
    if chosen.devices == DEVICES and tuple(chosen.methods) == METHODS:
        page = _PAGE.format(table=table, commit=current_commit(), machine=describe_machine())
        PAGE.write_text(page, encoding="utf-8")
    print(table)
    for method, devices in found.items():
        print(method, [(k, one.grade, one.suspect) for k, one in enumerate(devices) if one.suspect])


if __name__ == "__main__":
    main(sys.argv[1:])

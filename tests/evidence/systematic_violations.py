"""Systematic calibration: what the verdict says of faults, over some simulated devices.

Recordings of `systematic_table`, which knows nothing of inercal, are calibrated as files. η is the
norm of the whitened residuals that a fault leaves in a recording without noise, by the covariance
of the method itself: unlike in `python -m tests.evidence` it is not computed apart from inercal.

`python -m tests.evidence.systematic_violations` works out all of it and writes
docs/evidence/systematic-violations.json and the page beside it; `--devices` with another number
prints it only.
"""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any
from zlib import crc32

import numpy as np
from tests.evidence.cases.hand_recordings import npz_archive
from tests.evidence.graded_calibration import GradedCalibration, calibrate_files
from tests.evidence.stored_counts import FOLDER
from tests.evidence.stored_runs import store_runs
from tests.methods import systematic_table as made
from tests.methods.systematic_cases import sensor_of, solved, table_of

DATA, PAGE = FOLDER / "systematic-violations.json", FOLDER / "systematic-violations.md"
SEEDS, DEVICES, BASE_DEVICES = (1, 2, 3), 6, 30
GRADES = ("consistent", "reservations", "unreliable", "refused")
CREEP_SECONDS = 10.0
KNOCK_TIME = 300.0  # s, in a rest
_RUN = """\
[sensor]
name = "IMU"
[sensor.accelerometer]
unit = "m/s²"
white = "{force_white} µg/√Hz"
bias_instability = "{force_drift} µg"
[sensor.gyro]
unit = "rad/s"
white = "{gyro_white} °/√h"
bias_instability = "{gyro_drift} °/h"
[bench]
kind = "turntable"
readback = false
gravity = "{gravity} m/s² ± 1 µm/s²"
latitude = "{latitude} ° ± 0.001 °"
[data]
file = "log.npz"
time = "time"
accelerometer = ["ax", "ay", "az"]
gyro = ["gx", "gy", "gz"]
sample = "mean"
[method]
name = "systematic"
{coefficients}
"""


@dataclass(frozen=True)
class Fault:
    """What differs from what the run file states.

    Parameters
    ----------
    table : dict
        Fields of the table.
    gravity : float
        Stated over true, less one.
    latitude : callable
        From the true to the stated latitude, °.
    noise : float
        Stated over true.
    left_out : str
        Part of the names of coefficients that are not estimated.
    change : callable
        Of readings, (n, 6); with one sample less the times are the first ones.
    has_visibility : bool
        Whether it leaves residuals in a recording without noise.
    """

    table: dict[str, Any] | None = None
    gravity: float = 0.0
    latitude: Callable[[float], float] = lambda latitude: latitude
    noise: float = 1.0
    left_out: str = ""
    change: Callable[[made.Recorded], made.Recorded] | None = None
    has_visibility: bool = True


def _without_a_sample(recorded: made.Recorded) -> made.Recorded:
    k = int(np.searchsorted(recorded.time, recorded.rests[3, 1] + 4))
    reading = np.delete(recorded.reading, k, 0)
    return replace(recorded, reading=reading, time=recorded.time[:-1])


def _reversed(column: int, recorded: made.Recorded) -> made.Recorded:
    sign = np.ones(6)
    sign[column] = -1
    return replace(recorded, reading=recorded.reading * sign)


def _exchanged(recorded: made.Recorded) -> made.Recorded:
    return replace(recorded, reading=recorded.reading[:, [2, 1, 0, 3, 4, 5]])


def _clipped(recorded: made.Recorded) -> made.Recorded:
    most = 0.9 * np.abs(recorded.reading[:, 3:]).max()
    reading = recorded.reading.copy()
    reading[:, 3:] = np.clip(reading[:, 3:], -most, most)
    return replace(recorded, reading=reading)


ARCSEC = made.ARCSEC
TABLE = made.Table(gravity=9.8)  # a gravity of its latitude
FAULTS: dict[str, Fault] = {
    "none": Fault(),
    "latitude 0.1° off": Fault(latitude=lambda latitude: latitude + 0.1),
    "latitude 1° off": Fault(latitude=lambda latitude: latitude + 1.0),
    "other hemisphere": Fault(latitude=lambda latitude: -latitude),
    "gravity 40 ppm off": Fault(gravity=40e-6),
    "creep of 2″ after each turn": Fault({"creep": (2 * ARCSEC, CREEP_SECONDS)}),
    "creep of 10″ after each turn": Fault({"creep": (10 * ARCSEC, CREEP_SECONDS)}),
    "knock of 20″ in one rest": Fault({"knock": (20 * ARCSEC, KNOCK_TIME)}),
    "sway of 20″ at 1 Hz": Fault({"sway": (20 * ARCSEC, 1.0)}),
    "one sample lost in a turn": Fault(change=_without_a_sample),
    "noise stated at half": Fault(noise=0.5, has_visibility=False),
    "k2 left out": Fault(left_out=".k2"),
    "lever arms left out": Fault(left_out=".arm"),
    "gyros clipped at 0.9 of the rate": Fault(change=_clipped, has_visibility=False),
    "y of the gyros reversed": Fault(change=partial(_reversed, 4), has_visibility=False),
    "x and z of the accelerometers exchanged": Fault(change=_exchanged, has_visibility=False),
}


def recording(fault: str, grade: str, seed: int, k: int, *, noise: bool) -> made.Recorded:
    """Return the recording of one device with a fault of its table or of its samples."""
    own, of_grade = FAULTS[fault], made.GRADES[grade]
    rng = np.random.default_rng([seed, k, crc32(f"{grade} {fault}".encode())])
    truth, lag = made.draw_truth(of_grade, rng)
    table = replace(TABLE, **(own.table or {}))
    recorded = made.record(
        truth, lag, table, rng, grade=of_grade if noise else None, drift="flicker"
    )
    return recorded if own.change is None else own.change(recorded)


def kept_coefficients(fault: str, grade: str) -> tuple[str, ...]:
    """Return the coefficients that are estimated."""
    left_out = FAULTS[fault].left_out
    names = sensor_of(made.GRADES[grade]).coefficients
    return tuple(name for name in names if not left_out or left_out not in name)


def run_text(fault: str, grade: str) -> str:
    """Return the run file, with what it states wrongly."""
    own, of_grade, table = FAULTS[fault], made.GRADES[grade], TABLE
    kept = kept_coefficients(fault, grade)
    stated = {
        "force_white": of_grade.force_white / made.UG,
        "force_drift": of_grade.force_drift / made.UG,
        "gyro_white": of_grade.gyro_white / (np.pi / 180 / 60),
        "gyro_drift": of_grade.gyro_drift / made.DEG_H,
    }
    return _RUN.format(
        **{name: f"{own.noise * size:.6g}" for name, size in stated.items()},
        gravity=f"{table.gravity * (1 + own.gravity):.6f}",
        latitude=f"{own.latitude(float(np.degrees(table.latitude))):.4f}",
        coefficients=f"coefficients = {json.dumps(kept)}" if own.left_out else "",
    )


def answer(task: tuple[str, str, int, int]) -> GradedCalibration:
    """Return what inercal says of one device: fault, grade, seed and number."""
    fault, grade, seed, k = task
    recorded = recording(fault, grade, seed, k, noise=True)
    names = kept_coefficients(fault, grade)
    truth = {n: recorded.truth.get(n, 0.0) + recorded.drift_means.get(n, 0.0) for n in names}
    columns = dict(zip(("ax", "ay", "az", "gx", "gy", "gz"), recorded.reading.T, strict=True))
    log = npz_archive(time=recorded.time, **columns)
    return calibrate_files({"run.toml": run_text(fault, grade), "log.npz": log}, truth)


def visibility(task: tuple[str, str]) -> float:
    """Return η of a fault at a grade: root mean square over a device of each seed."""
    fault, grade = task
    own, table = FAULTS[fault], TABLE
    sensor = sensor_of(made.GRADES[grade], "flicker")
    sensor = replace(sensor, coefficients=kept_coefficients(fault, grade))
    latitude = own.latitude(float(np.degrees(table.latitude)))
    known = table_of(
        table, gravity=table.gravity * (1 + own.gravity), latitude=np.radians(latitude)
    )
    chi2 = [
        float(solved(recording(fault, grade, seed, 0, noise=False), sensor, known).chi2)
        for seed in SEEDS
    ]
    return math.sqrt(sum(chi2) / len(chi2))


def count(answers: list[GradedCalibration]) -> dict[str, Any]:
    """Return how many devices were graded how, and the median of the largest error over u."""
    largest = [max(map(abs, one.errors.values())) for one in answers if one.errors]
    graded = {word: sum(one.grade == word for one in answers) for word in GRADES}
    return {**graded, "error": round(float(np.median(largest)), 2) if largest else None}


def devices_of(fault: str, devices: int) -> int:
    """Return the number of devices of a fault, of all seeds."""
    return BASE_DEVICES * devices // DEVICES if fault == "none" else devices


def work_out(devices: int, pool: Any) -> dict[str, Any]:
    """Return all counts, by fault and grade."""
    cells = [(fault, grade) for fault in FAULTS for grade in made.GRADES]
    shown = [cell for cell in cells if FAULTS[cell[0]].has_visibility]
    tasks = [
        (*cell, seed, k)
        for cell in cells
        for seed in SEEDS
        for k in range(devices_of(cell[0], devices) // len(SEEDS))
    ]
    eta = dict(zip(shown, pool.map(visibility, shown, chunksize=1), strict=True))
    found = pool.map(answer, tasks, chunksize=3)
    counts: dict[str, Any] = {}
    for fault, grade in cells:
        own = [one for task, one in zip(tasks, found, strict=True) if task[:2] == (fault, grade)]
        size = eta.get((fault, grade))
        of_fault = counts.setdefault(fault, {})
        of_fault[grade] = {"eta": None if size is None else float(f"{size:.3g}"), **count(own)}
    return {
        "devices": devices,
        "seeds": list(SEEDS),
        "faults": counts,
    }


def page(found: dict[str, Any]) -> str:
    """Return the page of the stored counts."""
    lines = [
        "# Systematic calibration: faults, and what the verdict says of them, counted",
        "",
        "Written by `python -m tests.evidence.systematic_violations`; do not edit. The recordings",
        "are those of [errors and stated uncertainties](systematic.md), with 1/f noise. There are",
        f"{found['devices']} devices for each line, and {BASE_DEVICES} without a fault, with the",
        f"seeds {', '.join(map(str, found['seeds']))}. The run files state `readback = false`.",
        "Grade N is navigation grade, and grade T is tactical grade.",
        "",
        "η is the norm of the whitened residuals that the fault leaves in the rows of rests and",
        "turns, in a recording without noise. If η is 6 or more, the fault should be noticed.",
        "This η uses the covariance of the method itself, so it is not independent of inercal,",
        "unlike the η of other [violations](violations.md). The two halves of each rest are",
        "tested too. For each device, we took the largest error of a coefficient divided by its",
        "stated u; the last column is the median over the devices.",
        "",
        "| fault | grade | η | not consistent | unreliable | refused | largest error / u |",
        "|---|---|---|---|---|---|---|",
    ]
    for fault, grades in found["faults"].items():
        for grade, one in grades.items():
            devices = sum(one[word] for word in GRADES)
            eta = "" if one["eta"] is None else f"{one['eta']:.3g}"
            error = "" if one["error"] is None else f"{one['error']:.3g}"
            lines.append(
                f"| {fault} | {grade} | {eta} | {devices - one['consistent']} of {devices} | "
                f"{one['unreliable']} | {one['refused']} | {error} |"
            )
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    store_runs(__doc__, work_out, page, (DATA, PAGE), DEVICES, "--devices")

"""A line with simulated results: sensors of known scatter, in lots and at stations."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from inercal.fleet import results
from inercal.fleet.inputs import ABSENT, INSTALLED
from inercal.fleet.line import Line, read_line

Array = NDArray[np.float64]
COEFFICIENTS = tuple(f"a{k}.{term}" for k in "xyz" for term in ("k0", "k1", "delta_o", "delta_p"))
MG, PPM, ARCSEC = 9.80665e-3, 1e-6, np.pi / 648_000
UNITS = np.tile([MG, 1000 * PPM, 100 * ARCSEC, 100 * ARCSEC], 3)
TEMPLATE = """\
[sensor.accelerometer]
unit = "g"

[bench]
latitude = "48.1 °"
tilt = "0.1 °"

[data]
kind = "means"
label = "position"
accelerometer = ["acc_x", "acc_y", "acc_z"]

[data.sd]
accelerometer = "30 µg"

[method]
name = "six_position"
"""
LIMITS = """
[specification.limits]
bias = "± 12 mg"
scale = ["-12000 ppm", "14000 ppm"]
"""


@dataclass(frozen=True)
class Truth:
    """What is drawn, in the units of `UNITS`: 1 mg, 1000 ppm, 100″."""

    within: float = 3.0
    lots: float = 1.0
    u: float = 0.5
    lot_size: int = 500
    stations: int = 3
    station_shift: float = 0.0  # of ax.k0 at the last station
    drift: float = 0.0  # of ay.k0 over the serial order
    outliers: int = 0  # the first sensors, all coefficients 30 units off
    chi2_jump: float = 1.0  # of the first station, in the second half


def write_line(
    folder: Path, n: int, truth: Truth | None = None, *, seed: int = 1, limits: str = LIMITS,
    part: int = 200, generation: int = 1, further: Mapping[str, object] | None = None,
) -> Line:  # fmt: skip
    """Write a line of n sensors with its results; return it."""
    truth = truth or Truth()
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "run.toml").write_text(TEMPLATE + limits, encoding="utf-8")
    p = len(COEFFICIENTS)
    lot, station = np.arange(n) // truth.lot_size, np.arange(n) % truth.stations
    u = truth.u * rng.uniform(0.8, 1.2, (n, p))
    value = truth.lots * rng.normal(size=(lot[-1] + 1, p))[lot]
    value += truth.within * rng.normal(size=(n, p)) + u * rng.normal(size=(n, p))
    value[station == truth.stations - 1, 0] += truth.station_shift
    value[:, 4] += truth.drift * np.linspace(-0.5, 0.5, n)
    value[: truth.outliers] += 30
    dof = np.full(n, 6.0)
    chi2 = rng.chisquare(6, n)
    chi2[(station == 0) & (np.arange(n) > n // 2)] *= truth.chi2_jump
    begin = datetime(2026, 1, 1, tzinfo=UTC)
    names = [f"S{k:06d}" for k in range(n)]
    with (folder / "sensors.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["id", "recording", "lot", "station", "measured"])
        times = [(begin + timedelta(minutes=5 * k)).isoformat() for k in range(n)]
        columns = [(f"L{k:03d}", f"bench {j}") for k, j in zip(lot, station, strict=True)]
        writer.writerows(
            (name, f"{name}.csv", *both, time)
            for name, both, time in zip(names, columns, times, strict=True)
        )
    line = read_line(folder)
    triangle = [0.0] * (p * (p + 1) // 2)
    si, std = value * UNITS, u * UNITS
    for first in range(0, n, part):
        rows = [
            {
                "key": names[k], "id": names[k], "recording": f"{names[k]}.csv",
                "lot": columns[k][0], "station": columns[k][1], "measured": times[k],
                "table": [], "status": results.DONE, "grade": "consistent", "verdict": "",
                "chi2": float(chi2[k]), "dof": float(dof[k]), "birge": 1.0,
                "coefficients": " ".join(COEFFICIENTS), "value": si[k].tolist(),
                "std": std[k].tolist(), "covariance": triangle, "created": times[k],
                "sections_sha256": line.digest(line.rows[k]), "inercal": INSTALLED,
                "size": ABSENT.size, "mark": ABSENT.mark,  # as there are no recordings
            } | dict(further or {})
            for k in range(first, min(first + part, n))
        ]  # fmt: skip
        results.ResultWriter(folder / results.FOLDER, generation).write(rows)
    return line

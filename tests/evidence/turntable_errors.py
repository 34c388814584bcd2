"""Turntable: errors of many devices against what is stated, written to docs/evidence.

`python -m tests.evidence.turntable_errors` works out both parts and writes `turntables.json` and
`turntables.md`; with fewer devices they are printed and not written.

**Flicker**: devices of `tests.accuracy.turntable`, which imports nothing of inercal, whose biases
flicker over the whole run; the filters' estimates against the truth, a bias being its mean over the
run. The table's moves are S-curves: where an ideal trapezoid begins exactly at a sample, as it does
there with rates and accelerations that are whole, what rates miss within a sample has one sign at
all kinks. No table does so; scale factors of a navigation-grade gyro at 100 Hz would show it (z² of
2).

**Simulated**: the demonstration's run as `inercal simulate` makes it, without a host of the bench,
through `inercal calibrate`; one seed is one device on one bench.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from importlib.resources import files
from math import radians, sqrt
from multiprocessing import Pool, cpu_count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tests.accuracy import turntable
from tests.evidence.stored_counts import FOLDER, current_commit, describe_machine
from tests.methods.turntable_cases import bench, errors, observations, sensor

from inercal.methods.turntable_kalman import METHOD
from inercal.pipeline import apply_data_columns, calibrate, simulate
from inercal.pipeline.outcome import true_coefficients
from inercal.recordings.io.write import write_recording
from inercal.runfile import read as read_run

Array = NDArray[np.float64]
DATA, PAGE = FOLDER / "turntables.json", FOLDER / "turntables.md"
DEVICES, SEEDS = 60, (1, 2, 3)
HZ, BATCH = 100.0, 6
TABLE = turntable.Table(jerk=radians(300))
TACTICAL = turntable.grade(0.1, 0.5, 60, 15, flicker=True)
TEN_SECONDS = [("warm-up", (0, 0, 0), 120.0), *turntable.positions(10.0), *turntable.turns()]
FLICKER = {
    "navigation grade": (turntable.NAVIGATION, turntable.complete_path()),
    "navigation grade, holds of 10 s": (turntable.NAVIGATION, TEN_SECONDS),
    "tactical grade, holds of 10 s": (TACTICAL, TEN_SECONDS),
    "tactical grade": (TACTICAL, turntable.complete_path()),
}
SIMULATED = "simulated without the host"
PARAMETERS = 24
_PAGE = """\
# Turntable: actual errors and stated uncertainties

Written by `make evidence`; do not edit. NEES is the mean of (error)ᵀ covariance⁻¹ (error) over the
number of coefficients; 1 is expected. The column "chance" is three standard deviations of the
scatter of NEES by chance. In the first four rows, the biases have flicker noise. A generator that
is independent of inercal made these devices, and the `full` filters of `turntable_kalman`
calibrated them. The row "{simulated}" is the run of the demonstration, made with `inercal simulate`
and `inercal calibrate`.

{table}

Seeds {seeds} for flicker, 0 to {last} for the simulation; commit {commit}; {machine}.
"""


@dataclass(frozen=True)
class TurntableErrorRow:
    """One case and seed.

    Parameters
    ----------
    case : str
    seed : int
    devices : int
    gyros, accelerometers, whole : float
        NEES of the coefficients of each, and of all.
    consistent : int or None
        Devices whose verdict is so; None where no verdict is made.
    """

    case: str
    seed: int
    devices: int
    gyros: float
    accelerometers: float
    whole: float
    consistent: int | None = None

    @property
    def band(self) -> float:
        """Three standard deviations of `whole`."""
        return 3 * sqrt(2 / (PARAMETERS * self.devices))


def pool_rows(rows: Sequence[TurntableErrorRow]) -> TurntableErrorRow:
    """Return rows of one case as one, of seed 0."""
    n = [row.devices for row in rows]

    def mean(values: list[float]) -> float:
        return float(np.average(values, weights=n))

    verdicts = [row.consistent for row in rows if row.consistent is not None]
    return TurntableErrorRow(
        rows[0].case,
        0,
        sum(n),
        mean([row.gyros for row in rows]),
        mean([row.accelerometers for row in rows]),
        mean([row.whole for row in rows]),
        sum(verdicts) if verdicts else None,
    )


def flicker_nees(case: str, devices: int, seed: int, first: int = 0) -> TurntableErrorRow:
    """Return the NEES of devices of one of `FLICKER`, from the `first` of a seed on."""
    grade, path = FLICKER[case]
    of = sensor(grade)
    offs, covariances = list[Array](), list[Array]()
    for batch in range(first, first + devices, BATCH):
        count = min(BATCH, first + devices - batch)
        draw = turntable.draw(50_000 + 1000 * seed + batch, count, path, grade, TABLE, hz=HZ)
        estimate = METHOD.estimator("full")(observations(draw, of), of, bench(TABLE), ())
        off, covariance = errors(estimate, draw, of)
        offs.append(off)
        covariances.append(covariance)
    parts = mean_nees(of.coefficients, np.concatenate(offs), np.concatenate(covariances))
    return TurntableErrorRow(case, seed, devices, *parts)


def simulated_nees(devices: int, first: int = 0) -> TurntableErrorRow:
    """Return NEES and verdicts of the demonstration's run, simulated from the `first` seed on."""
    offs, covariances, consistent = list[Array](), list[Array](), 0
    names: tuple[str, ...] = ()
    text = files("inercal").joinpath("demo.toml").read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.toml"
        path.write_text(text.replace("recording.h5", "recording.npz"), encoding="utf-8")
        run = read_run(path)
        for seed in range(first, first + devices):
            write_recording(apply_data_columns(run, simulate(run, seed)), run.file(run.data.file))
            outcome = calibrate(path)
            found = outcome.calibration
            names, true = found.sensor.coefficients, true_coefficients(found, run.truth)
            offs.append(found.values - np.array([true[name] for name in names]))
            covariances.append(found.covariance)
            consistent += outcome.verdict.grade == "consistent"
    parts = mean_nees(names, np.array(offs), np.array(covariances))
    return TurntableErrorRow(SIMULATED, 0, devices, *parts, consistent)


def mean_nees(names: Sequence[str], off: Array, covariance: Array) -> tuple[float, float, float]:
    """Return the mean NEES a coefficient of gyros, of accelerometers and of all, (devices, p)."""
    kinds = np.array([name[0] for name in names])
    found: list[float] = []
    for kind in ("g", "a", "ga"):
        at = np.flatnonzero([one in kind for one in kinds])
        solved = np.linalg.solve(covariance[:, at][:, :, at], off[:, at, None])[..., 0]
        found.append(float(np.mean(np.sum(off[:, at] * solved, axis=1)) / at.size))
    return found[0], found[1], found[2]


def _task(task: tuple[str, int, int, int]) -> TurntableErrorRow:
    case, devices, seed, first = task
    if case == SIMULATED:
        return simulated_nees(devices, first)
    return flicker_nees(case, devices, seed, first)


def compute_rows(devices: int, processes: int, cases: Sequence[str]) -> list[TurntableErrorRow]:
    """Return the rows of cases and all their seeds, worked out side by side."""
    keys = [(case, seed) for case in cases for seed in (SEEDS if case in FLICKER else (0,))]
    tasks = [
        (case, min(BATCH, devices - first), seed, first)
        for case, seed in keys
        for first in range(0, devices, BATCH)
    ]
    found: dict[tuple[str, int], list[TurntableErrorRow]] = {key: [] for key in keys}
    with Pool(processes) as pool:
        for task, row in zip(tasks, pool.imap(_task, tasks), strict=True):
            found[task[0], task[2]].append(row)
    return [replace(pool_rows(parts), seed=seed) for (_, seed), parts in found.items()]


def table_text(rows: Sequence[TurntableErrorRow]) -> str:
    """Return the rows as a table, the seeds of a case pooled."""
    lines = [
        "| case | devices | gyros | accelerometers | all | chance | consistent |",
        "|" + "---|" * 7,
    ]
    for case in dict.fromkeys(row.case for row in rows):
        one = pool_rows([row for row in rows if row.case == case])
        verdict = "–" if one.consistent is None else f"{one.consistent} of {one.devices}"
        lines.append(
            f"| {case} | {one.devices} | {one.gyros:.3f} | {one.accelerometers:.3f} "
            f"| {one.whole:.3f} | ± {one.band:.3f} | {verdict} |"
        )
    return "\n".join(lines)


def write_rows(rows: Sequence[TurntableErrorRow], of: str) -> None:
    """Write data and page; `of` says by which commit which rows are."""
    run = {"commit": of, "machine": describe_machine()}
    FOLDER.mkdir(exist_ok=True)
    lines = ",\n".join("  " + json.dumps(asdict(row), ensure_ascii=False) for row in rows)
    head = json.dumps({"run": run | {"seeds": list(SEEDS)}}, ensure_ascii=False, indent=1)
    DATA.write_text(f'{head[:-2]},\n "rows": [\n{lines}\n]}}\n', encoding="utf-8")
    seeds = ", ".join(map(str, SEEDS))
    page = _PAGE.format(
        simulated=SIMULATED, table=table_text(rows), seeds=seeds, last=DEVICES - 1, **run
    )
    PAGE.write_text(page, encoding="utf-8")


def read_rows() -> list[TurntableErrorRow]:
    """Return the stored rows."""
    return [
        TurntableErrorRow(**row) for row in json.loads(DATA.read_text(encoding="utf-8"))["rows"]
    ]


def main(arguments: list[str]) -> None:
    """Work out all rows, and write or print them."""
    parser = argparse.ArgumentParser(prog="python -m tests.evidence.turntable_errors")
    parser.add_argument("--devices", type=int, default=DEVICES, help="of each case and seed")
    parser.add_argument("--processes", type=int, default=cpu_count())
    parser.add_argument("--simulated", action="store_true", help="the simulation alone")
    chosen = parser.parse_args(arguments)
    cases = (SIMULATED,) if chosen.simulated else (*FLICKER, SIMULATED)
    rows = compute_rows(chosen.devices, chosen.processes, cases)
    if chosen.devices == DEVICES:
        of = current_commit()
        if chosen.simulated:
            before = json.loads(DATA.read_text(encoding="utf-8"))["run"]["commit"]
            of = f"{before.partition(' ')[0]} (flicker) and {of} (simulation)"
            rows = [*(row for row in read_rows() if row.case != SIMULATED), *rows]
        write_rows(rows, of)
    print(table_text(rows))


if __name__ == "__main__":
    main(sys.argv[1:])

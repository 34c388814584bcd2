"""The whole command on a long recording: time from 10⁶ to 10⁷ samples, and the most memory.

`inercal calibrate` with its report, in a process of its own, of an IMU at 1 kHz that is held in
another attitude every 20 s: 50 rests, and 500. What it takes to start is the time of 12 rests at
100 Hz. The recordings are made and written some at a time.
"""

import os
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from tests.accuracy.generator import DEGREE, G0, mems
from tests.accuracy.handheld import Session, directions, record

from benchmarks import Row, Skipped

Array = NDArray[np.float64]
NAMES = ("time", "ax", "ay", "az", "gx", "gy", "gz")
RATE, EVERY, MOVE = 1000.0, 20.0, 1.5  # Hz, s from a rest to the next, s of the way
SIZES = (1_000_000, 10_000_000)
STEPS = np.repeat([16 * G0, 2000 * DEGREE], 3) / 2**15  # 16 bits for ±16 g and ±2000 °/s
TOGETHER = 12  # rests made at a time
REPEAT = 3
LIMIT = 1.5  # GB
RUN = """
[sensor.accelerometer]
unit = "m/s²"
[sensor.gyro]
unit = "rad/s"
[bench]
gravity = "9.81 m/s² ± 0.1 mm/s²"
[data]
file = "{file}"
time = "time"
accelerometer = ["ax", "ay", "az"]
gyro = ["gx", "gy", "gz"]
[method]
name = "multi_position"
also = ["g"]
"""
# A process's peak counts that of the one that started it: a small one starts the command.
MEASURE = """
import resource, subprocess, sys, time
begin = time.perf_counter()
subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, check=True)
print(time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""
COMMAND = "from inercal.cli.app import main; main()"


class Cost(NamedTuple):
    """What a run of the command took."""

    seconds: float
    memory: float  # bytes


def made(n: int, rate_hz: float = RATE, every: float = EVERY) -> Iterator[Array]:
    """Yield the readings (k, 6) of one session of n samples in all, SI.

    Parts meet in the middle of a rest: azimuth may jump there, which nothing feels without earth.
    """
    rng = np.random.default_rng(10)
    imu = mems(rng)
    session = Session(hold_seconds=every - MOVE, move_seconds=MOVE, rate_hz=rate_hz)
    half = round(session.hold_seconds * rate_hz) // 2
    ups, count = directions(24, rng), 0
    for first in range(0, sys.maxsize, TOGETHER):
        part = record(imu, session, rng, ups=ups[np.arange(first, first + TOGETHER + 1) % len(ups)])
        data = part.data[0, half if first else 0 : part.rests[-1][0] + half][: n - count]
        yield np.round(data / STEPS) * STEPS
        count += len(data)
        if count == n:
            return


def raw(path: Path, n: int, rate_hz: float = RATE, every: float = EVERY) -> Array:
    """Return time and readings, (7, n), in a file that stands for memory."""
    columns = np.lib.format.open_memmap(path, mode="w+", dtype=np.float64, shape=(len(NAMES), n))
    start = 0
    for part in made(n, rate_hz, every):
        stop = start + len(part)
        columns[0, start:stop] = np.arange(start, stop) / rate_hz
        columns[1:, start:stop] = part.T
        start = stop
    return columns


def save_npz(path: Path, columns: Array) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        for name, column in zip(NAMES, columns, strict=True):
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, column)


def save_parquet(path: Path, columns: Array) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    with pq.ParquetWriter(path, pa.schema([(name, pa.float64()) for name in NAMES])) as writer:
        for k in range(0, columns.shape[1], 1 << 18):
            part = np.ascontiguousarray(columns[:, k : k + (1 << 18)])
            writer.write_table(pa.table(dict(zip(NAMES, part, strict=True))))


def save_h5(path: Path, columns: Array) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name, column in zip(NAMES, columns, strict=True):
            file.create_dataset(name, data=column, chunks=(min(column.size, 1 << 16),))


SAVE = {".npz": save_npz, ".parquet": save_parquet, ".h5": save_h5}


def cost(path: Path, repeat: int = REPEAT) -> Cost:
    """Return the shortest time and the least memory of several runs of the command on a file."""
    run_file = path.with_suffix(".toml")
    run_file.write_text(RUN.format(file=path.name), encoding="utf-8")
    command = ["calibrate", str(run_file), "--out", str(path.parent)]
    # Modules are compiled by the first run, not by each, whatever the environment says.
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    environment["PYTHONPYCACHEPREFIX"] = str(path.parent / "compiled")
    costs: list[Cost] = []
    for _ in range(repeat):
        done: Any = subprocess.run(
            [sys.executable, "-c", MEASURE, sys.executable, "-c", COMMAND, *command],
            env=environment,
            capture_output=True,
            text=True,
            encoding="utf-8",
            check=False,
        )
        if done.returncode:
            raise RuntimeError(done.stderr)
        seconds, kilobytes = done.stdout.split()
        costs.append(Cost(float(seconds), 1024 * float(kilobytes)))
    return Cost(*(min(values) for values in zip(*costs, strict=True)))


def rows() -> list[Row | Skipped]:
    """Measure the command on files of three formats."""
    if sys.platform != "linux":
        return [Skipped("long recordings", "the most memory is read as Linux counts it")]
    rows: list[Row | Skipped] = []
    with TemporaryDirectory() as name:
        folder = Path(name)
        save_npz(folder / "short.npz", raw(folder / "short.npy", 5_400, 100.0, 4.5))
        cost(folder / "short.npz", 1)
        start = cost(folder / "short.npz").seconds
        columns = [raw(folder / f"{n}.npy", n) for n in SIZES]
        for suffix, save in SAVE.items():
            costs: list[Cost] = []
            for all_of_them in columns:
                path = folder / f"long{suffix}"
                save(path, all_of_them)
                costs.append(cost(path))
                path.unlink()
            few, many = costs
            work = f"10⁷ samples, hand-held ({suffix[1:]})"
            times = SIZES[1] / SIZES[0]
            beyond = times * (few.seconds - start)
            rows += [
                Row(f"{work}: calibrate", many.seconds, times * few.seconds, "10 times 10⁶"),
                Row(f"{work}: beyond start-up", many.seconds - start, beyond, "10 times 10⁶"),
                Row(f"{work}: most memory", many.memory / 1e9, LIMIT, "limit", "GB"),
            ]
    return rows

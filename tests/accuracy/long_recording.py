"""Long hand-held recordings, made and written some at a time, and what the command takes for one.

An IMU at a high rate that is held in one attitude after another, read with 16 bits.
"""

import os
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from tests.accuracy.ferraris import DEGREE, G0, mems
from tests.accuracy.handheld import Session, directions, record

Array = NDArray[np.float64]
NAMES = ("time", "ax", "ay", "az", "gx", "gy", "gz")
MOVE = 1.5  # s from a rest to the next
STEPS = np.repeat([16 * G0, 2000 * DEGREE], 3) / 2**15  # 16 bits for ±16 g and ±2000 °/s
TOGETHER = 12  # rests simulated at a time
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
import resource, subprocess, sys
subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, check=True)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss)
"""


class Cost(NamedTuple):
    """What a run of the command took."""

    seconds: float  # of processor time
    memory: float  # bytes


def generate_pieces(n: int, rate_hz: float, every: float) -> Iterator[Array]:
    """Yield the readings (k, 6) of one session of n samples in all, SI; a rest begins `every` s.

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


def write_raw_file(path: Path, n: int, rate_hz: float, every: float) -> Array:
    """Return time and readings, (7, n), mapped to a file in place of memory."""
    columns = np.lib.format.open_memmap(path, mode="w+", dtype=np.float64, shape=(len(NAMES), n))
    start = 0
    for part in generate_pieces(n, rate_hz, every):
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


def run_file(path: Path) -> Path:
    """Return the run file of the recording, in the same folder."""
    beside = path.with_suffix(f"{path.suffix}.toml")
    beside.write_text(RUN.format(file=path.name), encoding="utf-8")
    return beside


def measure_command(run: Path) -> Cost:
    """Run the command once."""
    command = ["calibrate", str(run), "--out", str(run.parent)]
    # The first run compiles modules, not each run, in any environment.
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    environment["PYTHONPYCACHEPREFIX"] = str(run.parent / "compiled")
    done = subprocess.run(
        [sys.executable, "-c", MEASURE, sys.executable, "-m", "inercal", *command],
        env=environment,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )
    if done.returncode:
        raise RuntimeError(done.stderr)
    seconds, kilobytes = done.stdout.split()
    return Cost(float(seconds), 1024 * float(kilobytes))

"""The whole command on a long recording: time from 10⁶ to 10⁷ samples, and the most memory.

`inercal calibrate` with its report, in a process of its own, of an IMU at 1 kHz that is held in
another attitude every 20 s: 50 rests, and 500. What it takes to start is the time of 12 rests at
100 Hz.
"""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from tests.accuracy.long_recording import SAVE, Cost, measure_command, run_file, write_raw_file

from benchmarks import Row, Skipped

RATE, EVERY = 1000.0, 20.0  # Hz, s from a rest to the next
SIZES = (1_000_000, 10_000_000)
REPEAT = 1  # more take several minutes
LIMIT = 1.5  # GB


def least(runs: Sequence[Path]) -> list[Cost]:
    """Return the least of several runs of each, by turns: a machine's pace changes."""
    measure_command(runs[0])
    turns = [[measure_command(run) for run in runs] for _ in range(REPEAT)]
    return [Cost(*np.min(costs, axis=0)) for costs in zip(*turns, strict=True)]


def rows() -> Iterator[Row | Skipped]:
    """Measure the command on files of three formats; yield the rows of each when they are."""
    if sys.platform != "linux":
        yield Skipped("long recordings", "the most memory is read as Linux counts it")
        return
    times = SIZES[1] / SIZES[0]
    with TemporaryDirectory() as name:
        folder = Path(name)
        short = write_raw_file(folder / "short.npy", 5_400, 100.0, 4.5)
        columns = [short, *(write_raw_file(folder / f"{n}.npy", n, RATE, EVERY) for n in SIZES)]
        for suffix, save in SAVE.items():
            paths = [folder / f"{some.shape[1]}{suffix}" for some in columns]
            for path, some in zip(paths, columns, strict=True):
                save(path, some)
            start, few, many = least([run_file(path) for path in paths])
            for path in paths:
                path.unlink()
            work = f"10⁷ samples, hand-held ({suffix[1:]})"
            own, peer = (size.seconds - start.seconds for size in (many, few))
            yield Row(f"{work}: calibrate", many.seconds, times * few.seconds, "10 times 10⁶")
            yield Row(f"{work}: beyond start-up", own, times * peer, "10 times 10⁶")
            yield Row(f"{work}: most memory", many.memory / 1e9, LIMIT, "limit", "GB")

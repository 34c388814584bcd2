"""The whole command on a long recording: processor time against the number of samples, and memory.

`inercal calibrate` with its report, in a process of its own, of an IMU at 1 kHz that is held in
another attitude every 20 s, in 10⁵ samples every 5 s. What a sample takes is counted from one
length to the next: the start, a few seconds, varies by as much as 10⁶ samples take.
"""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from tests.accuracy.long_recording import SAVE, Cost, measure_command, run_file, write_raw_file

from benchmarks import Row, Skipped

RATE, EVERY, RESTS = 1000.0, 20.0, 20  # Hz, s from a rest to the next, and rests at least
FEW, MANY, MOST = 100_000, 10_000_000, 30_000_000
GROWING = ".h5"  # the format of all three lengths; of the others, only the memory is measured
REPEAT = 1  # more take several minutes
GROWTH = 1.2  # times the samples
BYTES = 150.0  # most memory, of each sample


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
    with TemporaryDirectory() as name:
        folder = Path(name)
        columns = {
            n: write_raw_file(folder / f"{n}.npy", n, RATE, min(EVERY, n / RATE / RESTS))
            for n in (FEW, MANY, MOST)
        }
        for suffix, save in SAVE.items():
            sizes = (FEW, MANY, MOST) if suffix == GROWING else (FEW, MANY)
            paths = [folder / f"{n}{suffix}" for n in sizes]
            for path, n in zip(paths, sizes, strict=True):
                save(path, columns[n])
            few, many, *most = least([run_file(path) for path in paths])
            for path in paths:
                path.unlink()
            work = f"samples, hand-held ({suffix[1:]})"
            for cost in most:
                to_scale = (many.seconds - few.seconds) * (MOST - MANY) / (MANY - FEW)
                yield Row(
                    f"3·10⁷ {work}: beyond 10⁷", cost.seconds - many.seconds, to_scale,
                    "10⁵ to 10⁷, to scale", to_reach=1 / GROWTH,
                )  # fmt: skip
                memory = (cost.memory - few.memory) / (MOST - FEW)
                yield Row(f"3·10⁷ {work}: memory of a sample", memory, BYTES, "limit", "B")
            memory = (many.memory - few.memory) / (MANY - FEW)
            yield Row(f"10⁷ {work}: memory of a sample", memory, BYTES, "limit", "B")

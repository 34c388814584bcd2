"""The whole command on a long recording: processor time against the number of samples, and memory.

`inercal calibrate` with its report, in a process of its own, of an IMU at 1 kHz that is held in
another attitude every 20 s, in 10⁵ samples every 5 s. What it takes to start is the time of 12
rests at 100 Hz.
"""

import sys
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from tests.accuracy.long_recording import SAVE, Cost, measure_command, run_file, write_raw_file

from benchmarks import Row, Skipped

RATE, EVERY, RESTS = 1000.0, 20.0, 20  # Hz, s from a rest to the next, and rests at least
WORDS = {100_000: "10⁵", 1_000_000: "10⁶", 10_000_000: "10⁷", 30_000_000: "3·10⁷"}
# Files of 10⁷ samples of each format, and one format's from a short recording to 3·10⁷ samples.
SIZES: dict[str, tuple[int, ...]] = dict.fromkeys(SAVE, (1_000_000, 10_000_000))
SIZES[".h5"] = tuple(WORDS)
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
        short = write_raw_file(folder / "short.npy", 5_400, 100.0, 4.5)
        columns = {
            n: write_raw_file(folder / f"{n}.npy", n, RATE, min(EVERY, n / RATE / RESTS))
            for n in WORDS
        }
        for suffix, sizes in SIZES.items():
            written = [short, *(columns[n] for n in sizes)]
            paths = [folder / f"{some.shape[1]}{suffix}" for some in written]
            for path, some in zip(paths, written, strict=True):
                SAVE[suffix](path, some)
            start, *costs = least([run_file(path) for path in paths])
            for path in paths:
                path.unlink()
            for (few, short_cost), (many, cost) in pairwise(zip(sizes, costs, strict=True)):
                to_scale = many / few * (short_cost.seconds - start.seconds)
                yield Row(
                    f"{WORDS[many]} samples, hand-held ({suffix[1:]}): beyond start-up",
                    cost.seconds - start.seconds, to_scale, f"{WORDS[few]}, to scale",
                    to_reach=1 / GROWTH,
                )  # fmt: skip
            memory = (costs[-1].memory - start.memory) / sizes[-1]
            work = f"{WORDS[sizes[-1]]} samples, hand-held ({suffix[1:]})"
            yield Row(f"{work}: memory of a sample", memory, BYTES, "limit", "B")

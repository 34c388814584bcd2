"""A long plain CSV file: processor time of a row of seven columns, hash and checks included.

The peer reads the file with pyarrow alone, without hash, checks of the text or a block of columns.
"""

import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyarrow.csv

from benchmarks import Row
from inercal.recordings.io.column_table import ReadRequest
from inercal.recordings.io.text import read_text

ROWS = 500_000
NAMES = ("time", "ax", "ay", "az", "gx", "gy", "gz")
REPEAT = 5
LIMIT = 800.0  # ns a row


def nanoseconds_per_row(work: Callable[[], object]) -> float:
    """Return the least processor time of several calls, of all threads, ns a row."""
    work()
    times: list[float] = []
    for _ in range(REPEAT):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return min(times) / ROWS * 1e9


def rows() -> list[Row]:
    """Compare the numbers, then the times."""
    rng = np.random.default_rng(0)
    table = np.column_stack([np.arange(ROWS) / 1000, rng.normal(size=(ROWS, 6))])
    with TemporaryDirectory() as folder:
        path = Path(folder) / "recording.csv"
        with path.open("w", encoding="utf-8") as file:
            file.write(",".join(NAMES) + "\n")
            np.savetxt(file, table, fmt="%.6f", delimiter=",")
        wanted = ReadRequest(NAMES, (), NAMES[1:])
        read, peer = read_text(path, wanted), pyarrow.csv.read_csv(path)
        for name in NAMES:
            np.testing.assert_array_equal(read.numbers(name), peer.column(name).to_numpy())
        own = nanoseconds_per_row(lambda: read_text(path, wanted))
        other = nanoseconds_per_row(lambda: pyarrow.csv.read_csv(path))
    name = "CSV, a row of 7 columns"
    return [Row(name, own, LIMIT, "limit", "ns"), Row(name, own, other, "pyarrow alone", "ns")]

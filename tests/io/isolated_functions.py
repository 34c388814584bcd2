"""What libraries do with damaged files, for a process that reads them."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from inercal.recordings.io.column_table import ReadRequest, Table


def crash(path: Path, *_: object) -> Table:
    os.kill(os.getpid(), signal.SIGSEGV)
    raise AssertionError


def be_killed(path: Path) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def spin(path: Path) -> None:
    while True:
        pass


def hoard(path: Path) -> None:
    kept: list[bytearray] = []
    while True:
        kept.append(bytearray(1 << 20))


def exhaust_the_stack(path: Path) -> None:
    exhaust_the_stack(path)


def print_and_read(path: Path) -> str:
    os.write(1, b"a note of a library")
    print("another")
    return path.read_text("utf-8")


def process_id(path: Path) -> int:
    return os.getpid()


def blocks(path: Path, count: int) -> Iterator[np.ndarray]:
    for k in range(count):
        yield np.full((1 << 16, 3), float(k))
    if count > 5:
        raise ValueError("the fifth block is damaged")


def table(path: Path) -> Table:
    """Return a table whose columns are views of its block, and others."""
    request = ReadRequest(block_columns=("y", "x"), spare_columns=1)
    columns, block = request.empty_columns(5, ["t", "x", "y"])
    for k, column in enumerate(columns.values()):
        column[:] = np.arange(5) / 3 + k
    block[:, 2] = np.pi
    words = {"label": np.array(["a", "", "bb", "a", "µ"])}
    return Table(("t", "x", "y", "label"), {**columns, **words}, path.name, "", 0, True, block)

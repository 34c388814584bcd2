"""Files that cannot be used: each is refused quickly, with little memory, in one clear line."""

import gzip
import time
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.refusals import refused

from inercal.recordings.io.read import Columns, read_recording, read_table

COLUMNS = Columns(channels=(("x", "x", "g"), ("y", "y", "g")), time="t")
GOOD = "t,x,y\n" + "".join(f"{k / 100},{k % 7},{k % 5}\n" for k in range(200))


def lines(*changes: tuple[int, str]) -> bytes:
    """Return the good file with some lines, counted from 1, replaced."""
    text = GOOD.splitlines()
    for number, line in changes:
        text[number - 1] = line
    return ("\n".join(text) + "\n").encode()


JUNK = np.random.default_rng(1).integers(0, 256, 10_000, dtype=np.uint8).tobytes()
BAD: dict[str, tuple[bytes, dict[str, Any]]] = {
    "empty": (b"", {}),
    "blank": (b"\n \n", {}),
    "comments": (b"# nothing\n", {}),
    "header": (b"t,x,y\n", {"line": 1}),
    "truncated": (lines()[:-7] + b"\n", {"line": 201}),
    "ragged": (lines((50, "1,2,3,4")), {"line": 50}),
    "short": (lines((50, "1,2")), {"line": 50}),
    "mixed": (lines((3, "0.01;1;1")), {"line": 3}),
    "header apart": (lines((1, "t x y")), {"line": 2}),
    "word": (lines((9, "0.07,ERR,2")), {"line": 9, "names": ["x"]}),
    "decimals": (lines((9, "0.07,1_0,2")), {"line": 9, "names": ["x"]}),
    "units": (lines((3, "s,g,g")), {"line": 3, "names": ["t"]}),
    "wrong column": (lines((1, "t,X,y")), {"names": ["x"]}),
    "twice": (lines((1, "t,x,x")), {"names": ["x"]}),
    "nan": (lines((9, "0.07,nan,2")), {"line": 9, "names": ["x"]}),
    "empty cell": (lines((9, "0.07,,2")), {"line": 9, "names": ["x"]}),
    "inf": (lines((9, "inf,1,2")), {"line": 9, "names": ["time"]}),
    "huge": (lines((9, "0.07,1e400,2")), {"line": 9, "names": ["x"]}),
    "back": (lines((9, "0.01,1,2")), {"line": 9, "names": ()}),
    "stuck": (
        b"".join(b"0.0%d,1,%d\n" % (k, k) for k in range(9)).join([b"t,x,y\n", b""]),
        {"names": ["x"]},
    ),
    "same time": (lines((9, "0.06,1,2")), {"line": 9, "names": ()}),
    "junk": (JUNK, {"line": 2}),
    "late junk": (lines() + JUNK, {"line": 203}),
    "gzip": (gzip.compress(lines()), {"line": None}),
    "utf-16": (GOOD.encode("utf-16"), {"line": None}),
    "latin-1": ("t,x,y,°C\n".encode("latin-1"), {"line": 1}),
    "cut letter": (lines() + b"\xc3", {"line": 202}),
    "workbook": (b"PK\x03\x04" + JUNK, {"line": None}),
    "open quote": (lines((1, "t,x,y"), (2, '"0.1,1,1')), {"line": 2}),
    "transposed": (b",".join([b"1"] * 2000) + b"\n", {"line": None}),
    "transposed, quoted": (b";".join([b"1,5"] * 200_000) + b"\n", {"line": None}),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_refused_in_one_clear_line(tmp_path: Path, name: str):
    content, data = BAD[name]
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    start = time.perf_counter()
    with refused(file="log.csv", **data) as caught:
        read_recording(path, COLUMNS)
    assert time.perf_counter() - start < 1
    assert str(caught.value).startswith("log.csv")
    assert len(str(caught.value)) < 250


def test_one_line_of_a_hundred_million_characters_costs_little(tmp_path: Path):
    path = tmp_path / "log.csv"
    with path.open("wb") as file:
        for _ in range(100):
            file.write(b"1,2,3,4,5," * 100_000)
    tracemalloc.start()
    start = time.perf_counter()
    with refused(file=path, line=1):
        read_table(path)
    assert time.perf_counter() - start < 2
    assert tracemalloc.get_traced_memory()[1] < 200e6
    tracemalloc.stop()


@pytest.mark.slow
def test_a_long_line_is_found_across_blocks(tmp_path: Path):
    path = tmp_path / "log.csv"
    path.write_bytes(b"1,2\n" * ((1 << 22) - 100_000) + b"1" * 1_000_001 + b"\n1,2\n")
    with refused(line=(1 << 22) - 100_000 + 1):
        read_table(path)


def test_a_folder_and_a_missing_file_are_named(tmp_path: Path):
    with refused(file=tmp_path):
        read_table(tmp_path)
    with refused(file="none.csv"):
        read_table(tmp_path / "none.csv")


def test_many_columns_are_not_all_listed(tmp_path: Path):
    path = tmp_path / "log.csv"
    path.write_text(",".join(f"c{k}" for k in range(50)) + "\n" + ",".join(["1"] * 50) + "\n")
    with refused(names=["q"]) as refusal:
        read_table(path, wanted=["q"])
    assert len(str(refusal.value)) < 150


@pytest.mark.parametrize(("row", "seconds"), [(99_990, 2.0), (10, 2.0)])
def test_the_bad_line_of_a_long_file_is_found_soon(tmp_path: Path, row: int, seconds: float):
    text = [f"{k},1.5,2.5" for k in range(100_000)]
    text[row] = "1,2"
    path = tmp_path / "log.csv"
    path.write_text("\n".join(text) + "\n")
    start = time.perf_counter()
    with refused(line=row + 1):
        read_table(path)
    assert time.perf_counter() - start < seconds

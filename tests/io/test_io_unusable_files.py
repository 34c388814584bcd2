"""Files that cannot be used: each gives one clear line, quickly and with little memory."""

import gzip
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from inercal.errors import InputError
from inercal.io.read import Columns, read_recording, read_table

COLUMNS = Columns(channels=(("x", "x", "g"), ("y", "y", "g")), time="t")
GOOD = "t,x,y\n" + "".join(f"{k / 100},{k % 7},{k % 5}\n" for k in range(200))


def lines(*changes: tuple[int, str]) -> bytes:
    """Return the good file with some lines, counted from 1, put otherwise."""
    text = GOOD.splitlines()
    for number, line in changes:
        text[number - 1] = line
    return ("\n".join(text) + "\n").encode()


JUNK = np.random.default_rng(1).integers(0, 256, 10_000, dtype=np.uint8).tobytes()
BAD = {
    "empty": (b"", "log.csv is empty"),
    "blank": (b"\n \n", "log.csv is empty"),
    "comments": (b"# nothing\n", "comments only"),
    "header": (b"t,x,y\n", "has a header in line 1 and no data below it"),
    "truncated": (
        lines()[:-7] + b"\n",
        r"log\.csv line 201: 1 column where the header has 3; the file may be truncated: "
        r"remove the line or record again",
    ),
    "ragged": (lines((50, "1,2,3,4")), r"line 50: 4 columns where the header has 3; repair"),
    "short": (lines((50, "1,2")), r"line 50: 2 columns where the header has 3"),
    "mixed": (lines((3, "0.01;1;1")), r"line 3: 1 column where the header has 3"),
    "header apart": (lines((1, "t x y")), r"line 2: 3 columns where the header has 1; separate"),
    "word": (lines((9, "0.07,ERR,2")), r"line 9, column 'x': 'ERR' is not a number"),
    "decimals": (lines((9, "0.07,1_0,2")), r"line 9, column 'x': '1_0' is not a number"),
    "units": (lines((2, "s,g,g")), r"column 'x' holds text \(g\) where numbers are needed"),
    "wrong column": (lines((1, "t,X,y")), r"no column 'x'; did you mean 'X'\? It has t, X, y"),
    "twice": (lines((1, "t,x,x")), r"has 2 columns 'x': rename all but one"),
    "nan": (lines((9, "0.07,nan,2")), r"1 row without a finite number, the first x at line 9"),
    "empty cell": (lines((9, "0.07,,2")), r"1 row without a finite number, the first x at line 9"),
    "inf": (lines((9, "inf,1,2")), r"the first time at line 9: remove them, or state nonfinite"),
    "huge": (lines((9, "0.07,1e400,2")), r"the first x at line 9"),
    "back": (lines((9, "0.01,1,2")), r"time goes back by 0\.05 s at line 9: was the clock reset"),
    "stuck": (
        b"".join(b"0.0%d,1,%d\n" % (k, k) for k in range(9)).join([b"t,x,y\n", b""]),
        "x reads 1 throughout",
    ),
    "same time": (lines((9, "0.06,1,2")), r"1 row with the time of the row before .* at line 9"),
    "junk": (JUNK, "binary data|not UTF-8"),
    "late junk": (lines() + JUNK, r"log\.csv line 20\d"),
    "gzip": (gzip.compress(lines()), "compressed with gzip: unpack it first"),
    "utf-16": (GOOD.encode("utf-16"), "is UTF-16 text; save it as UTF-8"),
    "latin-1": ("t,x,y,°C\n".encode("latin-1"), "line 1: byte 0xb0 is not UTF-8"),
    "cut letter": (lines() + b"\xc3", "line 202: byte 0xc3 is not UTF-8"),
    "workbook": (b"PK\x03\x04" + JUNK, "no .npz archive or is damaged"),
    "open quote": (lines((1, "t,x,y"), (2, '"0.1,1,1')), "line 2: 1 column where the header"),
    "on its side": (b",".join([b"1"] * 2000) + b"\n", "2000 columns; at most 1000"),
    "on its side, quoted": (b";".join([b"1,5"] * 200_000) + b"\n", "200000 columns; at most 1000"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_refused_in_one_clear_line(tmp_path: Path, name: str):
    content, message = BAD[name]
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    start = time.perf_counter()
    with pytest.raises(InputError, match=message) as caught:
        read_recording(path, COLUMNS)
    assert time.perf_counter() - start < 1
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("log.csv")
    assert len(str(caught.value)) < 250


def test_one_line_of_a_hundred_million_characters_costs_little(tmp_path: Path):
    path = tmp_path / "log.csv"
    with path.open("wb") as file:
        for _ in range(100):
            file.write(b"1,2,3,4,5," * 100_000)
    tracemalloc.start()
    start = time.perf_counter()
    with pytest.raises(InputError, match="line 1: more than 1000000 bytes without a line end"):
        read_table(path)
    assert time.perf_counter() - start < 2
    assert tracemalloc.get_traced_memory()[1] < 200e6
    tracemalloc.stop()


def test_a_long_line_is_found_across_blocks(tmp_path: Path):
    path = tmp_path / "log.csv"
    path.write_bytes(b"1,2\n" * ((1 << 22) - 100_000) + b"1" * 1_000_001 + b"\n1,2\n")
    with pytest.raises(InputError, match=f"line {(1 << 22) - 100_000 + 1}: more than"):
        read_table(path)


def test_a_folder_and_a_missing_file_are_named(tmp_path: Path):
    with pytest.raises(InputError, match="is a folder; name a file in it"):
        read_table(tmp_path)
    with pytest.raises(InputError, match=r"none\.csv cannot be read: No such file"):
        read_table(tmp_path / "none.csv")


def test_many_columns_are_not_all_listed(tmp_path: Path):
    path = tmp_path / "log.csv"
    path.write_text(",".join(f"c{k}" for k in range(50)) + "\n" + ",".join(["1"] * 50) + "\n")
    with pytest.raises(InputError, match=r"no column 'q'; it has c0, .*, c11, … \(50 in all\)"):
        read_table(path, wanted=["q"])


@pytest.mark.parametrize(("row", "seconds"), [(99_990, 2.0), (10, 2.0)])
def test_the_bad_line_of_a_long_file_is_found_soon(tmp_path: Path, row: int, seconds: float):
    text = [f"{k},1.5,2.5" for k in range(100_000)]
    text[row] = "1,2"
    path = tmp_path / "log.csv"
    path.write_text("\n".join(text) + "\n")
    start = time.perf_counter()
    with pytest.raises(InputError, match=f"line {row + 1}: 2 columns where line 1 has 3"):
        read_table(path)
    assert time.perf_counter() - start < seconds

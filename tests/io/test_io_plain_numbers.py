"""The fast way for plain text gives what the tolerant one gives: arrays, lines, refusals."""

import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from inercal.basics.errors import InputError
from inercal.recordings.io import plain_numbers, text
from inercal.recordings.io.column_table import ReadRequest, Table, shorten
from inercal.recordings.io.plain_numbers import LONGEST_LINE, scan

Read = Callable[[Path, ReadRequest], Table]
ALL = ReadRequest()


@pytest.fixture
def loads(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Try the fast way for small files too; list whether it read each file."""
    fast, found = plain_numbers.load_plain, list[bool]()

    def load_plain(*arguments: object) -> object:
        result = fast(*arguments)  # pyright: ignore[reportArgumentType]
        found.append(result is not None)
        return result

    monkeypatch.setattr(plain_numbers, "SMALLEST", 0)
    monkeypatch.setattr(plain_numbers, "_FEWEST_LINES", 0)
    monkeypatch.setattr(text, "load_plain", load_plain)
    return found


@pytest.fixture
def tolerant(monkeypatch: pytest.MonkeyPatch) -> Read:
    """Return the reading of a file by the tolerant way."""

    def read(path: Path, wanted: ReadRequest) -> Table:
        with monkeypatch.context() as patch:
            patch.setattr(text, "load_plain", lambda *_: None)
            return text.read_text(path, wanted)

    return read


def content(read: Read, path: Path, wanted: ReadRequest = ALL) -> object:
    """Return all that is read, arrays as bytes, or the message of the refusal."""
    try:
        table = read(path, wanted)
    except InputError as error:
        return str(error), error.line
    columns = {
        name: (some.dtype.str, np.ascontiguousarray(some).tobytes())
        for name, some in table.columns.items()
    }
    block = None if table.block is None else table.block.tobytes()
    return table.names, columns, table.sha256, table.first_line, table.header, block


def written(rng: random.Random) -> str:
    """Return a number as programs write it."""
    value = rng.choice([rng.gauss(0, 1), rng.gauss(0, 1) * 10.0 ** rng.randint(-320, 308), 0.0])
    forms = ("{!r}", "{:.17g}", "{:.3f}", "{:.6e}", "{:.25g}", "{:E}", "{:.0f}.", " {:g}", "{:g} ")
    number = rng.choice(forms).format(value)
    return number[1:] if number.startswith("0.") and len(number) > 3 else number


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_plain_numbers_are_equal_to_the_last_bit(
    loads: list[bool], tolerant: Read, tmp_path: Path, delimiter: str, end: str
):
    rng = random.Random(1)
    path = tmp_path / "a.csv"
    names = ("t", "x", "y", "z")
    rows = [delimiter.join(written(rng) for _ in names) for _ in range(3_000)]
    for header in ([], [delimiter.join(names)], ["# Ω", "", delimiter.join(names)]):
        path.write_bytes(end.join([*header, *rows]).encode())
        wanted = ReadRequest(names[1:] if header else None, (), names[1:3] if header else ())
        assert content(text.read_text, path, wanted) == content(tolerant, path, wanted)
    assert loads == [True] * 3


def test_columns_of_words_are_the_same_labels(loads: list[bool], tolerant: Read, tmp_path: Path):
    path = tmp_path / "a.csv"
    rows = [f"{k},{k / 7!r},{'north ' if k % 2 else ' süd'},{k % 3}" for k in range(1_000)]
    path.write_text("\n".join(["t,x,label,step", *rows]), encoding="utf-8")
    wanted = ReadRequest(None, ("step",))
    assert content(text.read_text, path, wanted) == content(tolerant, path, wanted)
    assert loads == [True]


@pytest.mark.parametrize("label", [",süd", ""])
@pytest.mark.parametrize("tail", ["", "\n", "\r\n\r\n"])
def test_a_plain_file_is_scanned_while_it_is_parsed(
    monkeypatch: pytest.MonkeyPatch, loads: list[bool], tmp_path: Path, label: str, tail: str
):
    path = tmp_path / "a.csv"
    rows = [f"{k},{k / 7!r}{label}" for k in range(20_000)]
    path.write_text("\n".join(["# µ", "t,x,y"[: 5 if label else 3], *rows]) + tail, "utf-8")
    expected = scan(path)
    monkeypatch.setattr(text, "scan", lambda _: pytest.fail("read twice"))
    table = text.read_text(path, ALL)
    assert (table.sha256, table.rows) == (expected.sha256, len(rows))
    assert table.line(len(rows) - 1) == expected.lines == len(rows) + 2
    assert loads == [True]


@pytest.mark.parametrize("wanted", [ALL, ReadRequest(("label",))])
def test_more_rows_than_the_samples_show_are_read(
    monkeypatch: pytest.MonkeyPatch, loads: list[bool], tolerant: Read, tmp_path: Path,
    wanted: ReadRequest,
):  # fmt: skip
    path = tmp_path / "a.csv"
    path.write_text("t,label\n" + "".join(f"{k},north\n" for k in range(50)))
    monkeypatch.setattr(text, "probable_rows", lambda _: 39)
    assert content(text.read_text, path, wanted) == content(tolerant, path, wanted)
    assert loads[-1]
    assert len(loads) == 2


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [b"\xff", b"\0", b"7" * (LONGEST_LINE + 1)])
def test_what_is_no_text_is_refused_before_a_missing_column(
    loads: list[bool], tmp_path: Path, wrong: bytes
):
    path = tmp_path / "a.csv"
    for place in (0, 7, 30):  # in the header, in the first row, below
        content_ = b"time,x,north\n" + b"1,2,north\n" * 9
        path.write_bytes(content_[:place] + wrong + content_[place:])
        for names in (("time",), ("time", "north"), ("y",)):
            with pytest.raises(InputError) as expected:
                scan(path)
            with pytest.raises(InputError) as found:
                text.read_text(path, ReadRequest(names))
            assert (str(found.value), found.value.line) == (
                str(expected.value),
                expected.value.line,
            )
    assert True not in loads


@pytest.mark.slow
def test_odd_files_are_read_or_refused_as_by_the_tolerant_way(
    loads: list[bool], tolerant: Read, tmp_path: Path
):
    rng = random.Random(2)
    odd = ["", " ", "nan", "-nan", "NaN(7)", "inf", "1e999", "1e-999", "+1", "0x10", "1_0", "1 2",
           "--1", "#", "1#2", '"1"', '"', "e5", "1,5", "1;5", "\t", "1d3", "١", "1e", ".", "-",
           "%", "1\n", "\n2", "\r", "1,", "true", "infinity", "\ufeff1", "1j", " 3 "]  # fmt: skip
    path = tmp_path / "a.csv"
    for trial in range(700):
        rows = [[written(rng) for _ in range(3)] for _ in range(rng.randint(1, 8))]
        for _ in range(rng.randint(1, 2)):
            rows[rng.randrange(len(rows))][rng.randrange(3)] = rng.choice(odd)
        if rng.random() < 0.2:
            rows[rng.randrange(len(rows))].append("4")
        head = ["t,x,y"] if trial % 2 else []
        path.write_text("\n".join([*head, *map(",".join, rows)]), encoding="utf-8", newline="")
        assert content(text.read_text, path) == content(tolerant, path), path.read_bytes()
    assert set(loads) == {True, False}


def test_without_pyarrow_and_for_small_files_the_tolerant_way_reads(
    monkeypatch: pytest.MonkeyPatch, loads: list[bool], tmp_path: Path
):
    path = tmp_path / "a.csv"
    path.write_text("t,x\n1,2\n3,4\n")
    monkeypatch.setattr(plain_numbers, "SMALLEST", path.stat().st_size + 1)
    text.read_text(path, ReadRequest())
    monkeypatch.setattr(plain_numbers, "SMALLEST", 0)
    text.read_text(path, ReadRequest())
    monkeypatch.setattr(plain_numbers, "find_spec", lambda _: None)
    text.read_text(path, ReadRequest())
    assert loads == [False, True, False]


@pytest.mark.parametrize("blocks", [7, 8, 4096])
def test_the_line_that_is_too_long_is_named_whatever_the_blocks(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, blocks: int
):
    monkeypatch.setattr("inercal.recordings.io.plain_numbers.BLOCK_BYTES", blocks)
    monkeypatch.setattr("inercal.recordings.io.plain_numbers.LONGEST_LINE", 9)
    path = tmp_path / "a.csv"
    path.write_text("1234\n\n12345678\n12345678\n1")
    assert scan(path)[1:] == (5, 5)
    path.write_text("1234\n\n12345678\n1234567890\n1")
    with pytest.raises(InputError, match="line 4: more than 9 bytes"):
        scan(path)
    assert LONGEST_LINE == 1_000_000


@pytest.mark.parametrize("length", range(8, 24))
def test_a_shortened_text_ends_with_an_ellipsis_wherever_it_is_cut(length: int):
    cut = shorten("gx.bias, gx.scale, gx.delta_o", length)
    assert len(cut) <= length
    assert cut.endswith("…")
    assert shorten("gx.bias", length) == "gx.bias"

"""Logs of fifteen formats as careless hands, loggers and spreadsheets change them.

`python -m tests.fuzz.log_mutations FORMAT SEED FIRST LAST` drafts a run file from each and prints
what became of them.
"""

import random
import re
import sys
import tempfile
import tomllib
import warnings
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import scipy.io
from tests import generated_logs as logs
from tests.fuzz.recording_mutations import mutated, mutated_within
from tests.io.log_files import BOOT_NS, Samples, dataflash_bytes, ulog_bytes
from tests.io.ros_files import ACCEL, RAW, Sent, messages, write_bag, write_bag2
from tests.io.test_io_xlsx import workbook

from inercal.basics.errors import InputError
from inercal.pipeline.drafts import draft_run_file

Cell = float | str
Columns = dict[str, list[Cell]]
Change = Callable[[Columns, random.Random], None]
MOST_SECONDS = 5.0  # of processor for a draft

_NAMES = (
    "x", "ax", "Acc X [g]", "acc_x (m/s^2)", "GyroX", "gx (deg/s)", "w_z", "time", "t_ms", "millis",
    "timestamp (ns)", "temp", "Temp [°C]", "label", "pose", "angle", "rpm", "mounting", "outer",
    "psi", "up", "axis", "1", "", " ", "ax,ay", "µ", "-(X Accel)", "mag_x", "roll", "n", "head",
)  # fmt: skip
_CELLS: tuple[Cell, ...] = (
    float("nan"), float("inf"), 1e300, -1e-320, 0.0, "", " ", "nan", "-", "N/A", "12a", "1.2.3",
    "1,234.5", "1 234,5", "0x1F", "1e", "--3", "true", "#DIV/0!", "°", "a;b", '"', "=A1", "9" * 400,
)  # fmt: skip
_UNITS = (
    " [g]",
    " (mg)",
    " (m/s^2)",
    "_raw",
    " [deg/s]",
    " (rad/s)",
    " LSB",
    "_ms",
    " [s]",
    " (V)",
)


def _any(table: Columns, rng: random.Random) -> str:
    return rng.choice(list(table))


def _reorder(table: Columns, order: list[str]) -> None:
    columns = [(name, table[name]) for name in order]
    table.clear()
    table.update(columns)


def _shuffle(table: Columns, rng: random.Random) -> None:
    _reorder(table, rng.sample(list(table), len(table)))


def _rename(table: Columns, rng: random.Random) -> None:
    old = _any(table, rng)
    new = rng.choice((rng.choice(_NAMES), old + rng.choice(_UNITS), old.upper(), _any(table, rng)))
    columns = [(new if name == old else name, cells) for name, cells in table.items()]
    table.clear()
    table.update(columns)


def _drop_column(table: Columns, rng: random.Random) -> None:
    if len(table) > 1:
        del table[_any(table, rng)]


def _double_column(table: Columns, rng: random.Random) -> None:
    name = _any(table, rng)
    table[name + rng.choice(("2", "_raw", " "))] = list(table[name])


def _constant_column(table: Columns, rng: random.Random) -> None:
    name = _any(table, rng)
    table[name] = [rng.choice((0.0, 1.0, table[name][0], "x"))] * len(table[name])


def _scaled(table: Columns, rng: random.Random) -> None:
    """Change the unit or sign of one column or of all but the first."""
    names = [_any(table, rng)] if rng.random() < 0.5 else list(table)[1:]
    factor = rng.choice((9.80665, 1e-3, 1e3, 57.3, 16384.0, -1.0, 1e-9, 1e12, 0.0))
    for name in names:
        table[name] = [one if isinstance(one, str) else one * factor for one in table[name]]
        if factor == 16384.0:  # counts
            table[name] = [float(np.rint(c)) if isinstance(c, float) else c for c in table[name]]


def _rows(table: Columns, at: list[int]) -> None:
    for name, cells in table.items():
        table[name] = [cells[k] for k in at]


def _move_rows(table: Columns, rng: random.Random) -> None:
    """Drop, double, exchange, reverse or sort rows, or keep only a few."""
    n = len(next(iter(table.values())))
    at = list(range(n))
    a, b = sorted(rng.sample(range(n + 1), 2)) if n > 1 else (0, n)
    match rng.randrange(7):
        case 0:
            at = at[:a] + at[b:]
        case 1:
            at = at[:b] + at[a:]
        case 2:
            at = at[b:] + at[a:b] + at[:a]
        case 3:
            at = at[::-1]
        case 4:
            at = at[: rng.choice((0, 1, 2, 3, 7, 50, 499, 501))]
        case 5:
            at = [k for k in at if rng.random() > 0.1]
        case _:
            at = at[:: rng.choice((2, 3, 10))]
    _rows(table, at)


def _cells(table: Columns, rng: random.Random) -> None:
    """Put other cells in one column, in one place, in some, or in all."""
    name = _any(table, rng)
    cell, share = rng.choice(_CELLS), rng.choice((0.0, 0.02, 0.6, 1.0))
    cells = table[name]
    where = {rng.randrange(len(cells))} if cells else set[int]()
    table[name] = [
        cell if k in where or rng.random() < share else one for k, one in enumerate(cells)
    ]


def _times(table: Columns, rng: random.Random) -> None:
    """Change the first column, which contains the times unless the columns were moved."""
    name = next(iter(table))
    n = len(table[name])
    t = np.arange(n) * rng.choice((0.04, 0.01, 1e-6, 0.0, 3600.0))
    made: dict[int, Callable[[], Any]] = {
        0: lambda: t[::-1],
        1: lambda: np.floor(t),
        2: lambda: t * 1e3,
        3: lambda: np.rint(t * 1e6) % 65536,
        4: lambda: 1.78e18 + t * 1e9,
        5: lambda: t + 0.02 * np.random.default_rng(rng.randrange(99)).normal(size=n),
        6: lambda: [f"2026-11-29T12:{int(s) // 60 % 60:02d}:{s % 60:06.3f}Z" for s in t],
        7: lambda: np.where(np.arange(n) > n // 2, t - 3, t),
        8: lambda: np.where(np.arange(n) > n // 2, t + 1e5, t),
        9: lambda: [f"{int(s) // 3600:02d}:{int(s) // 60 % 60:02d}:{s % 60:06.3f}" for s in t],
        10: lambda: -t,
        11: lambda: np.arange(n) % 256,
    }
    table[name] = list(made[rng.randrange(len(made))]())


def _more_column(table: Columns, rng: random.Random) -> None:
    """Add labels, a thermometer, a counter or another sensor."""
    n = len(next(iter(table.values())))
    name = rng.choice(_NAMES[9:])
    made = (
        [f"p{k // 80}" for k in range(n)],
        ["move" if k % 80 < 20 else "rest" for k in range(n)],
        [rng.choice(("+x", "-x", "+y", "-y", "+z", "-z")) for _ in range(n)],
        [20.0 + 0.01 * k for k in range(n)],
        [float(k % 256) for k in range(n)],
        [rng.gauss(0, 1) for _ in range(n)],
        [float(k // 50 * 90) for k in range(n)],
    )
    table[name] = list[Cell](rng.choice(made))


CHANGES: tuple[Change, ...] = (
    _shuffle, _rename, _rename, _drop_column, _double_column, _constant_column, _scaled, _move_rows,
    _move_rows, _cells, _cells, _times, _times, _more_column,
)  # fmt: skip


@cache
def _sources() -> tuple[dict[str, Any], ...]:
    hand = logs.by_hand(5, rests=9, hz=25.0)
    axes = {f"a{axis}": hand["f"][:, k] for k, axis in enumerate("xyz")}
    rates = {f"g{axis}": hand["w"][:, k] for k, axis in enumerate("xyz")}
    means = {f"a{axis}": column for axis, column in zip("xyz", logs.poses(3, 20).T, strict=True)}
    force, celsius = logs.six_faces(3, 25.0)
    faces = {"t": np.arange(len(force)) / 50} | dict(zip("xyz", force.T, strict=True))
    every = {"t": hand["t"], **axes, **rates}
    return every, every, {"t": hand["t"], **axes}, means, faces | {"temp": celsius}


def changed_table(rng: random.Random) -> Columns:
    """Return one of the logs after one to three changes of its columns, rows and cells."""
    table: Columns = {name: column.tolist() for name, column in rng.choice(_sources()).items()}
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        rng.choice(CHANGES)(table, rng)
    return table


def _text(cell: Cell) -> str:
    return cell if isinstance(cell, str) else f"{cell:.7g}"


def _write_text(separator: str, decimal: str = ".", form: str = "") -> Callable[..., None]:
    """Return a function that writes a table as text, and then changes the text and its bytes."""

    def write(path: Path, table: Columns, rng: random.Random) -> None:
        rows = [
            [_text(one).replace(".", decimal) for one in r]
            for r in zip(*table.values(), strict=True)
        ]
        names = list(table)
        if form == "labels":
            lines = [" ".join(f"{n}:{c}" for n, c in zip(names, row, strict=True)) for row in rows]
        else:
            lines = [separator.join(row) for row in rows]
        if form != "labels" and rng.random() > 0.12:
            lines.insert(0, separator.join(names))
        if form == "arrival":
            lines = [
                f"10:11:{k // 100 % 60:02d}.{k % 100:02d}0 -> {s}" for k, s in enumerate(lines)
            ]
        path.write_bytes(_changed_text(lines, rng))

    return write


def _changed_text(lines: list[str], rng: random.Random) -> bytes:
    end, encoding = "\n", "utf-8"
    match rng.randrange(30):
        case 0:
            encoding = rng.choice(("utf-8-sig", "utf-16", "utf-16-le", "latin-1", "utf-32"))
        case 1:
            end = rng.choice(("\r\n", "\r", "\n\n", "\n\r"))
        case 2:
            lines = [line.replace(".", ",") for line in lines]
        case 3:
            lines = [re.sub(r"(\d)(\d{3})\b", r"\1,\2", line) for line in lines]
        case 4:
            lines = ["device: A7", "rate: 100 Hz", "", *lines]
        case 5:
            lines = [*lines, rng.choice(("# end", "OK", ",,,,", "mean 1 2 3", "\x00" * 40))]
        case 6:
            lines = [f'"{line}"' for line in lines]
        case 7:
            at = rng.randrange(len(lines) + 1)
            lines = [*lines[:at], *lines[:1], *lines[at:]]  # the header again
        case 8:
            lines = [line + rng.choice((",", " ", ";")) for line in lines]
        case 9:
            lines = [line[: rng.randrange(len(line) + 1)] if rng.random() < 0.01 else line
                     for line in lines]  # fmt: skip
        case 10:
            lines = [line.replace(",", rng.choice((";", " , ", "\t"))) for line in lines]
        case _:
            pass
    raw = (end.join(lines) + end).encode(encoding, "replace")
    return mutated(raw, rng) if rng.random() < 0.1 else raw


def _arrays(table: Columns) -> dict[str, Any]:
    """Return columns of numbers as floats, and the others as text; names as variables."""
    found: dict[str, Any] = {}
    for k, (name, cells) in enumerate(table.items()):
        texts = any(isinstance(one, str) for one in cells)
        column = np.array([_text(c) for c in cells]) if texts else np.array(cells, dtype=float)
        found[re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")[:30] or f"c{k}"] = column
    return found


def _write_hdf5(path: Path, table: Columns) -> None:
    with h5py.File(path, "w") as file:
        for name, column in _arrays(table).items():
            file[name] = column.tolist() if column.dtype.kind == "U" else column


def _write_mat(path: Path, table: Columns) -> None:
    columns = {
        f"c{name}" if name[0] in "_0123456789" else name: column.astype(object)
        if column.dtype.kind == "U"
        else column
        for name, column in _arrays(table).items()
    }
    scipy.io.savemat(path, columns, appendmat=False)


def _write_xlsx(path: Path, table: Columns) -> None:
    rows = [[_sheet_cell(one) for one in row] for row in zip(*table.values(), strict=True)]
    workbook(path, [list(table), *rows])


def _sheet_cell(cell: Cell) -> Cell | None:
    if isinstance(cell, str):
        return cell
    return cell if np.isfinite(cell) else None


def _then_bytes(write: Callable[[Path, Columns], Any]) -> Callable[..., None]:
    """Return a function that writes a table, and sometimes changes bytes of the file."""

    def changed(path: Path, table: Columns, rng: random.Random) -> None:
        write(path, table)
        if rng.random() < 0.25:
            raw = path.read_bytes()
            path.write_bytes((mutated_within if rng.random() < 0.5 else mutated)(raw, rng))

    return changed


def _samples(table: Columns) -> Samples:
    """Return the first seven columns of numbers as the samples of a flight log."""
    columns = [c for c in _arrays(table).values() if c.dtype.kind != "U"]
    n = len(next(iter(table.values()))) or 1
    columns = [c for c in columns if c.size] or [np.zeros(n)]
    t, *others = [one[:: 1 + n // 400] for one in [*columns, *[np.zeros(n)] * 7][:7]]
    t = np.nan_to_num(t, nan=0.0, posinf=0.0, neginf=0.0)
    ns = BOOT_NS + (np.clip(t, -10.0, 1e8) * 1e9).astype(np.int64)
    with np.errstate(over="ignore"):
        acc, gyr = (np.stack(o, axis=-1).astype(np.float32) for o in (others[:3], others[3:6]))
    acc, gyr = acc * np.float32(logs.G), gyr * np.float32(np.pi / 180)
    return Samples(ns, acc, gyr, np.full(len(t), 25.0, np.float32))


def _sent(samples: Samples, *, first: bool) -> list[Sent]:
    """Return the messages of an IMU and of an accelerometer alone."""
    return [one for one in messages(samples, first) if one[0] in (RAW, ACCEL)]


class Format(NamedTuple):
    """How a table is written as a log, with the changes that its format allows."""

    suffix: str
    write: Callable[[Path, Columns, random.Random], None]


def _flight(make: Callable[[Path, Samples], Any]) -> Callable[..., None]:
    return _then_bytes(lambda path, table: make(path, _samples(table)))


FORMATS: dict[str, Format] = {
    "csv": Format(".csv", _write_text(",")),
    "tab": Format(".tsv", _write_text("\t")),
    "semicolon": Format(".csv", _write_text(";", ",")),
    "space": Format(".txt", _write_text("  ")),
    "monitor": Format(".log", _write_text(",", form="arrival")),
    "plotter": Format(".txt", _write_text("", form="labels")),
    "xlsx": Format(".xlsx", _then_bytes(_write_xlsx)),
    "npz": Format(".npz", _then_bytes(lambda path, table: np.savez(path, **_arrays(table)))),
    "mat": Format(".mat", _then_bytes(_write_mat)),
    "h5": Format(".h5", _then_bytes(_write_hdf5)),
    "parquet": Format(
        ".parquet",
        _then_bytes(
            lambda path, table: pq.write_table(
                pa.table({n: c.tolist() for n, c in _arrays(table).items()}), path
            )
        ),
    ),
    "ulog": Format(".ulg", _flight(lambda path, s: path.write_bytes(ulog_bytes(s)))),
    "dataflash": Format(".bin", _flight(lambda path, s: path.write_bytes(dataflash_bytes(s)))),
    "bag": Format(".bag", _flight(lambda path, s: write_bag(path, _sent(s, first=True)))),
    "mcap": Format(".mcap", _flight(lambda path, s: write_bag2(path, _sent(s, first=False)))),
}


TEXTS = ("csv", "tab", "semicolon", "space", "monitor", "plotter")


def write_mutation(name: str, folder: Path, seed: int, number: int) -> Path:
    """Write one mutation of a format, which its numbers determine."""
    rng = random.Random(f"{name} {seed} {number}")
    form = FORMATS[name]
    path = folder / f"log{form.suffix}"
    path.unlink(missing_ok=True)
    form.write(path, changed_table(rng), rng)
    return path


def drafted(path: Path) -> str:
    """Return what became of a log: "drafted", "asked" or "refused".

    Raises
    ------
    Exception
        Anything but an `InputError` of one line, or a draft that is no TOML or takes too long.
    """
    begin = process_time()
    try:
        draft = draft_run_file([path], path.with_suffix(".toml"))
    except InputError as error:
        if not str(error) or "\n" in str(error):
            raise AssertionError(repr(error)) from error
        told = "refused"
    else:
        tomllib.loads(draft.text)
        told = "asked" if draft.questions else "drafted"
    assert process_time() - begin < MOST_SECONDS
    return told


def main() -> None:
    """Print what became of a range of mutations, and the traceback of each that fails."""
    import traceback

    name, seed, first, last = sys.argv[1], *map(int, sys.argv[2:5])
    warnings.simplefilter("error")
    told: Counter[str] = Counter()
    slowest = (0.0, 0)
    with tempfile.TemporaryDirectory() as folder:
        for number in range(first, last):
            path = write_mutation(name, Path(folder), seed, number)
            begin = process_time()
            try:
                told[drafted(path)] += 1
            except Exception as error:
                told["failed"] += 1
                print(f"--- {name} {seed} {number}")
                own = [
                    f for f in traceback.extract_tb(error.__traceback__) if "src/inercal" in f[0]
                ]
                print(*(f"    {f.filename}:{f.lineno}" for f in own[-3:]), repr(error), sep="\n")
            slowest = max(slowest, (process_time() - begin, number))
    print(name, dict(told), "slowest", slowest)


if __name__ == "__main__":
    main()

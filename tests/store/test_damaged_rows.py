"""A register whose rows were damaged, or hold what nobody reads: one line, at once."""

import json
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from tests.base_seeds import evidence
from tests.program import run_program
from tests.store.calibration_generator import DRIFTING, hashed, ten, write

from inercal.laboratory.store import Register

NAME = DRIFTING.sensor
VALUES = (None, b"\xff\x00", 7, -1.5, 10**18, "", "yesterday", "[" * 5000, '{"a": 1}', "\x1b[2J")


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("register")
    with Register(str(folder / "r.db")) as register:
        register.enter_calibrations(ten(folder)[:3])
    return folder / "r.db"


def columns(path: Path) -> list[tuple[str, str]]:
    with closing(sqlite3.connect(path)) as db:
        tables = [
            name for (name,) in db.execute("SELECT name FROM sqlite_master WHERE type='table'")
        ]
        return [
            (table, row[1])
            for table in tables
            if table in ("sensor", "calibration", "coefficient", "bench")
            for row in db.execute(f"PRAGMA table_info({table})")
        ]


@pytest.mark.slow
@pytest.mark.parametrize("every", [6, evidence(1)])
def test_damaged_values_give_one_line_in_every_verb(sound: Path, tmp_path: Path, every: int):
    path, refused = tmp_path / "r.db", 0
    for n, (table, column) in enumerate(columns(sound)):
        for k, value in enumerate(VALUES):
            if (n + k) % every:
                continue
            shutil.copy(sound, path)
            with closing(sqlite3.connect(path)) as db:
                db.execute("PRAGMA ignore_check_constraints = ON")
                try:
                    db.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = 1", (value,))
                except sqlite3.IntegrityError:
                    continue  # SQLite itself refuses it
                db.commit()
            verbs: tuple[tuple[str, ...], ...] = (
                ("list",),
                ("show", NAME),
                ("show", "1"),
                ("history", NAME),
            )
            verb = verbs[k % len(verbs)]
            for json_ in ((), ("--json",)):
                code, _, error = run_program("store", *verb, *json_, "--register", path)
                assert code in (0, 2), (table, column, value)
                assert error.count("\n") == (code != 0), (table, column, value, error)
                refused += code != 0
    assert refused > 50 / every


def damaged_content(path: Path, change: Callable[[str], str]) -> None:
    with closing(sqlite3.connect(path)) as db:
        (text,) = db.execute("SELECT content FROM calibration WHERE id = 1").fetchone()
        db.execute("UPDATE calibration SET content = ? WHERE id = 1", (change(text),))
        db.commit()


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace('"value":', '"value":1', 1),
        lambda text: text[:1000],
        lambda _: "7",
        lambda text: text.replace('"method"', '"methods"', 1),
    ],
)
def test_a_damaged_document_is_named(sound: Path, tmp_path: Path, change: Callable[[str], str]):
    path = tmp_path / "r.db"
    shutil.copy(sound, path)
    damaged_content(path, change)
    for verb in (("show", "1"), ("history", NAME), ("diff", "1", "2")):
        code, _, error = run_program("store", *verb, "--register", path)
        assert (code, error.count("\n")) == (2, 1)
        assert "calibration #1" in error


@pytest.mark.slow
def test_a_note_that_nobody_reads_is_cut(sound: Path, tmp_path: Path):
    path = tmp_path / "r.db"
    shutil.copy(sound, path)
    note = "word " * 2_000_000  # 10 MB
    document = tmp_path / "a.calibration.json"
    (first, *_) = ten(tmp_path)
    write(document, hashed(json.loads(first.read_text("utf-8")) | {"notes": [note]}))
    with Register(str(path)) as register:
        number = register.enter_calibration(document)
    code, output, _ = run_program("store", "show", str(number), "--register", path)
    assert code == 0
    assert len(output) < 100_000
    assert note[:2000] not in output

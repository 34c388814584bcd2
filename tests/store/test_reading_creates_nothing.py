"""Verbs that only read, and imports that fail, create no register."""

from pathlib import Path

import psycopg
import pytest
from tests.refusals import refused
from tests.store.calibration_generator import ten

from inercal.cli.app import main
from inercal.laboratory.store import Register

READING = [["list"], ["list", "--runs"], ["show", "SN 1"], ["history", "SN 1"], ["diff", "1", "2"]]


def status(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> object:
    monkeypatch.setattr("sys.argv", ["inercal", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        main()
    return stop.value.code


@pytest.mark.parametrize("verb", READING)
@pytest.mark.parametrize("place", ["option", "environment", "default"])
def test_a_verb_that_reads_creates_nothing_and_ends_with_status_2(
    verb: list[str], place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = tmp_path / "register.db"
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.delenv("INERCAL_REGISTER", raising=False)
    if place == "environment":
        monkeypatch.setenv("INERCAL_REGISTER", str(path))
    option = ["--register", path] if place == "option" else []
    assert status(monkeypatch, "store", *verb, *option) == 2
    assert list(tmp_path.iterdir()) == []


def test_an_import_that_fails_creates_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "none.calibration.json").write_text("{}")
    (tmp_path / "folder").mkdir()
    before = sorted(tmp_path.rglob("*"))
    for path in ("none.calibration.json", "folder", "missing.json"):
        into = ["--register", tmp_path / "register.db"]
        assert status(monkeypatch, "store", "import", tmp_path / path, *into) == 2
    assert sorted(tmp_path.rglob("*")) == before


def test_a_mistyped_address_is_refused_with_the_nearest_file(tmp_path: Path):
    with Register(str(tmp_path / "laboratory.db")) as register:
        register.enter_calibrations(ten(tmp_path))
    with refused(file="labratory.db", names=("laboratory.db",)):
        Register(str(tmp_path / "labratory.db"), create=False)
    with refused(file="x.db", names=()):
        Register(str(tmp_path / "nowhere" / "x.db"), create=False)
    assert not (tmp_path / "labratory.db").exists()


def test_an_empty_database_of_a_server_stays_empty_where_it_is_only_read(database: str):
    with refused():
        Register(database, create=False)
    with psycopg.connect(database) as server:
        tables = server.execute("SELECT 1 FROM pg_tables WHERE schemaname = 'public'").fetchall()
    assert tables == []


@pytest.mark.parametrize("newest", [1, 3, 10, 11])
def test_the_newest_are_the_last_of_all_in_the_same_order(tmp_path: Path, newest: int):
    with Register(str(tmp_path / "register.db")) as register:
        register.enter_calibrations(ten(tmp_path))
        everything = register.calibrations()
        assert register.calibrations(newest=newest) == everything[-newest:]
        sensor = everything[0].sensor
        assert register.calibrations(sensor, newest) == everything[-newest:]

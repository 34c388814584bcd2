"""Certificates in the register are immutable, and a backup keeps them."""

from datetime import date
from pathlib import Path

import pytest
from sqlalchemy import create_engine, text
from sqlalchemy.exc import DBAPIError
from tests.program import run_program
from tests.refusals import refused
from tests.store.calibration_generator import ten

from inercal.laboratory.store import (
    CertificateEntry,
    CertificateFiles,
    CertificateRequest,
    Register,
    backup_register,
    restore_register,
)
from inercal.laboratory.store.connection import resolve_address
from inercal.laboratory.store.register_tables import certificate


def make(number: str, previous: CertificateEntry | None) -> CertificateFiles:
    return CertificateFiles(f"%PDF {number}".encode(), f"<dcc>{number}</dcc>".encode())


def request(change: str = "", previous: str = "") -> CertificateRequest:
    return CertificateRequest("{year}-{sequence:4}", date(2026, 3, 1), change, previous, make)


@pytest.fixture
def filled(address: str, tmp_path: Path) -> str:
    """Return a register with ten calibrations and two certificates."""
    files = ten(tmp_path)
    with Register(address, by="Ada") as register:
        register.enter_calibrations(files)
        register.issue_certificate(files[0], request(), "2026-02-01")
        register.issue_certificate(files[1], request("amended", "2026-0001"), "2026-02-01")
    return address


def test_a_certificate_is_kept_with_its_files_and_who_issued_it(filled: str):
    with Register(filled) as register:
        entry = register.certificate("2026-0001")
        assert entry.files == make("2026-0001", None)
        assert (entry.by, entry.issued, entry.change) == ("Ada", "2026-03-01", "")
        assert register.successors("2026-0001") == (("2026-0002", "amended"),)


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE certificate SET number = 'mine'",
        "UPDATE certificate SET pdf_sha256 = '' WHERE number = '2026-0001'",
        "DELETE FROM certificate WHERE number = '2026-0001'",
    ],
)
def test_no_statement_changes_or_deletes_a_certificate(statement: str, filled: str):
    engine = create_engine(resolve_address(filled).url)
    with pytest.raises(DBAPIError, match="immutable"), engine.begin() as db:
        db.execute(text(statement))
    engine.dispose()
    with Register(filled) as register:
        assert register.certificate("2026-0001").files == make("2026-0001", None)


@pytest.mark.parametrize("key", ["id", "number", "series, year, sequence"])
def test_no_row_takes_the_place_of_a_certificate(key: str, tmp_path: Path):
    """SQLite replaces rows without deleting them by name."""
    address = str(tmp_path / "register.db")
    with Register(address) as register:
        register.issue_certificate(ten(tmp_path)[0], request(), "2026-02-01")
    engine = create_engine(resolve_address(address).url)
    names = [column.name for column in certificate.columns]
    other = {"id": "9", "number": "'9'", "sequence": "9"}  # but for the key, which stays
    values = [name if name in key else other.get(name, name) for name in names]
    statement = f"INSERT OR REPLACE INTO certificate SELECT {', '.join(values)} FROM certificate"
    with pytest.raises(DBAPIError, match="immutable"), engine.begin() as db:
        db.execute(text(statement))
    engine.dispose()


def test_files_that_cannot_be_made_use_no_number(filled: str, tmp_path: Path):
    def fails(number: str, previous: CertificateEntry | None) -> CertificateFiles:
        raise ValueError(number)

    wanted = CertificateRequest("{year}-{sequence:4}", date(2026, 3, 1), "", "", fails)
    first = tmp_path / "0.calibration.json"
    with Register(filled) as register:
        with pytest.raises(ValueError, match="2026-0003"):
            register.issue_certificate(first, wanted, "2026-02-01")
        assert register.issue_certificate(first, request(), "2026-02-01").number == "2026-0003"


def test_a_number_of_two_patterns_is_refused(filled: str, tmp_path: Path):
    wanted = CertificateRequest("2026-{sequence:4}{year}", date(2026, 1, 1), "", "", make)
    other = CertificateRequest("{year}-000{sequence}", date(2026, 1, 1), "", "", make)
    first = tmp_path / "0.calibration.json"
    with Register(filled) as register:
        assert register.issue_certificate(first, wanted, "2026-02-01").number == "2026-00012026"
        with refused(key="certificate_number"):
            register.issue_certificate(first, other, "2026-02-01")


@pytest.mark.slow
def test_a_backup_restores_everything_into_any_register(filled: str, tmp_path: Path, database: str):
    backup = tmp_path / "backup.db"
    rows = backup_register(filled, backup)
    assert (rows["calibration"], rows["certificate"]) == (10, 2)
    with Register(filled) as register:
        before = register.sensors(), register.calibrations(), register.certificate("2026-0002")
    targets = [str(tmp_path / "restored.db")]
    if not filled.startswith("postgresql"):
        targets.append(database)
    for target in targets:
        assert restore_register(backup, target) == rows
        with Register(target) as register:
            after = register.sensors(), register.calibrations(), register.certificate("2026-0002")
            assert after == before
            first = tmp_path / "0.calibration.json"
            issued = register.issue_certificate(first, request(), "2026-02-01")
            assert issued.number == "2026-0003"


def test_a_register_that_holds_something_is_not_restored_over(filled: str, tmp_path: Path):
    backup = tmp_path / "backup.db"
    backup_register(filled, backup)
    with refused(key="--register"):
        restore_register(backup, filled)


def test_what_is_no_backup_is_refused_and_nothing_is_left(tmp_path: Path):
    path = tmp_path / "text.db"
    path.write_text("no database", encoding="utf-8")
    target = tmp_path / "new.db"
    with refused(file=path):
        restore_register(path, str(target))
    with refused(key="--register"):
        backup_register(str(target), tmp_path / "backup.db")
    assert {one.name for one in tmp_path.iterdir()} == {"text.db"}


def test_a_damaged_certificate_is_not_backed_up(tmp_path: Path):
    address = str(tmp_path / "register.db")
    files = ten(tmp_path)
    with Register(address) as register:
        register.issue_certificate(files[0], request(), "2026-02-01")
    engine = create_engine(resolve_address(address).url)
    with engine.begin() as db:
        db.execute(text("DROP TRIGGER keep_certificate_update"))
        db.execute(text("UPDATE certificate SET pdf = 'x'"))
    engine.dispose()
    with refused(names=("2026-0001",)):
        backup_register(address, tmp_path / "backup.db")
    assert not (tmp_path / "backup.db").exists()


@pytest.mark.slow
def test_the_verbs_say_what_they_wrote_and_write_over_nothing(tmp_path: Path):
    address, backup = str(tmp_path / "register.db"), tmp_path / "backup.db"
    with Register(address) as register:
        register.enter_calibrations(ten(tmp_path))
    ended = run_program("store", "backup", backup, "--register", address)
    assert (ended.status, "10 calibrations" in ended.output) == (0, True)
    assert run_program("store", "backup", backup, "--register", address).status == 2
    assert run_program("store", "backup", backup, "--force", "--register", address).status == 0
    refusal = run_program("store", "backup", address, "--force", "--register", address)
    assert refusal.status == 2
    assert "--out" not in refusal.error
    other = str(tmp_path / "other.db")
    assert run_program("store", "restore", backup, "--register", other).status == 0
    assert run_program("store", "restore", backup, "--register", other).status == 2

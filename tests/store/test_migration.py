"""A register is brought up to date when it is opened, and one that is newer is left alone."""

import sqlite3
from pathlib import Path

import psycopg
import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import create_engine
from tests.refusals import refused
from tests.store.calibration_generator import ten

from inercal.basics.errors import InputError
from inercal.laboratory.store import Register
from inercal.laboratory.store.connection import VERSION_TABLE, resolve_address
from inercal.laboratory.store.register_tables import metadata


def revised(address: str, revision: str) -> None:
    """Say in a register that its tables are of another revision."""
    engine = create_engine(resolve_address(address).url)
    with engine.begin() as db:
        db.exec_driver_sql(f"UPDATE {VERSION_TABLE} SET version_num = '{revision}'")
    engine.dispose()


def create(address: str) -> None:
    """Create the tables: a file is created as soon as it is used."""
    with Register(address) as register:
        assert register.sensors() == ()


def test_migrations_lead_to_the_tables_of_this_version(address: str):
    create(address)
    engine = create_engine(resolve_address(address).url)
    with engine.connect() as db:
        context = MigrationContext.configure(db, opts={"version_table": VERSION_TABLE})
        assert compare_metadata(context, metadata) == []
        assert context.get_current_revision() == "1"
    engine.dispose()


def test_opening_again_keeps_everything(address: str, tmp_path: Path):
    with Register(address) as register:
        register.enter_calibrations(ten(tmp_path))
        before = register.calibrations()
    with Register(address) as register:
        assert register.calibrations() == before


@pytest.mark.parametrize("revision", ["0001", "0004"])
def test_a_register_from_before_the_first_release_is_refused(address: str, revision: str):
    create(address)
    revised(address, revision)
    with refused(InputError, key="--register"):
        Register(address)
    revised(address, "1")
    Register(address).close()


def test_a_newer_register_is_refused_and_left_as_it_is(address: str):
    create(address)
    revised(address, "9999")
    with refused(InputError, key="--register") as refusal:
        Register(address)
    assert "9999" in str(refusal.value)
    assert "\n" not in str(refusal.value)
    revised(address, "1")
    Register(address).close()


def test_a_creation_that_fails_leaves_an_empty_database(
    address: str, monkeypatch: pytest.MonkeyPatch
):
    def fails(*_: object, **__: object) -> None:
        raise InputError("stopped within", key="stopped")

    monkeypatch.setattr("alembic.command.stamp", fails)  # the tables exist already
    with refused(key="stopped"):
        create(address)
    monkeypatch.undo()
    with Register(address) as register:
        assert register.sensors() == ()


def test_a_database_of_something_else_is_refused_and_left_as_it_is(tmp_path: Path, database: str):
    path = tmp_path / "other.db"
    db = sqlite3.connect(path)
    db.execute("CREATE TABLE sensor (a)")
    db.close()
    before = path.read_bytes()
    with psycopg.connect(database) as server:
        server.execute("CREATE TABLE sensor (a int)")
    for address in (str(path), database):
        with refused(InputError, key="--register") as refusal:
            Register(address)
        assert "'sensor'" in str(refusal.value)
    assert path.read_bytes() == before

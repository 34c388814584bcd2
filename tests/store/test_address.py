"""Where a register is: what is taken, what is refused in one line, and that no password is said."""

import json
import os
import socket
import sqlite3
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused
from tests.store.calibration_generator import DRIFTING, content, ten, write
from tests.store.conftest import GUARDED, PASSWORD

from inercal.basics.errors import InputError
from inercal.calibration.files import parse
from inercal.cli.app import main
from inercal.laboratory.store import Register
from inercal.laboratory.store.connection import resolve_address


def refusal(address: str) -> str:
    with refused(InputError, key="--register") as refused_address:
        Register(address)
    message = str(refused_address.value)
    assert "\n" not in message
    assert "secret" not in message
    return message


def test_the_usual_place_is_below_the_users_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("INERCAL_REGISTER", raising=False)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    assert resolve_address().file == tmp_path / "data" / "inercal" / "register.db"
    Register().close()
    assert (tmp_path / "data" / "inercal").is_dir()
    for relative in ("data", ""):
        monkeypatch.setenv("XDG_DATA_HOME", relative)
        monkeypatch.setenv("HOME", str(tmp_path / "home"))
        expected = tmp_path / "home" / ".local" / "share" / "inercal" / "register.db"
        assert resolve_address().file == resolve_address("default").file == expected
    monkeypatch.setenv("INERCAL_REGISTER", str(tmp_path / "own.db"))
    assert resolve_address().file == resolve_address("default").file == tmp_path / "own.db"
    assert resolve_address(str(tmp_path / "said.db")).file == tmp_path / "said.db"


def test_a_usual_place_that_cannot_be_made_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "file").write_text("")
    monkeypatch.delenv("INERCAL_REGISTER", raising=False)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "file"))
    with refused(file="register.db"):
        Register()


@pytest.mark.parametrize(
    "text",
    ["postgresql://a@h/b", "postgres://a@h/b", "postgresql+psycopg://a@h/b"],
)
def test_the_driver_of_a_server_is_chosen_here(text: str):
    address = resolve_address(text)
    assert address.url.drivername == "postgresql+psycopg"
    assert address.display_url == "postgresql://a@h/b"


@pytest.mark.parametrize(
    "text",
    [
        "postgresql://ada:secret@host:5432/lab",
        "postgresql://ada@host/lab?password=secret&sslmode=require",
        "postgresql://ada@host/lab?sslpassword=secret",
        "postgresql://ada:%20secret%40@host/lab",
    ],
)
def test_a_password_is_never_printed(text: str):
    address = resolve_address(text)
    assert "secret" not in address.display_url
    assert "secret" not in repr(address)
    assert "***" in address.display_url or "hidden" in address.display_url
    assert "ada" in address.display_url


@pytest.mark.parametrize(
    "text",
    [
        "mysql://ada:secret@host/lab",
        "sqlite://",
        "sqlite:///",
        "http://host/",
        "",
        "postgresql://ada:secret@host:port/lab",
        "postgresql://ada:sec@secret@host/lab",
        "postgresql://",
    ],
)
def test_an_address_of_no_register_is_refused_in_one_line(
    text: str, monkeypatch: pytest.MonkeyPatch
):
    for name in ("PGHOST", "PGPORT", "PGUSER", "PGDATABASE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PGHOST", "/nowhere")
    assert "postgresql://" in refusal(text)


def test_a_server_that_is_not_there_is_refused_with_its_address_and_no_password():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    message = refusal(f"postgresql://ada:secret@127.0.0.1:{port}/lab")
    assert message.startswith(f"register postgresql://ada:***@127.0.0.1:{port}/lab: ")
    assert "refused" in message.lower()


@pytest.mark.slow
def test_a_server_without_that_database_says_so(database: str):
    name = database.partition("@/")[2].partition("?")[0]
    assert "does not exist" in refusal(database.replace(name, "none"))


def test_a_password_is_read_from_a_file_or_the_environment_as_by_libpq(
    guarded: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = tmp_path / "passwords"
    path.touch(mode=0o600)
    monkeypatch.setenv("PGPASSFILE", str(path))
    monkeypatch.delenv("PGPASSWORD", raising=False)
    path.write_text(f"*:*:*:{GUARDED}:not{PASSWORD[:2]}\n")
    assert PASSWORD not in refusal(guarded)
    escaped = PASSWORD.replace("\\", "\\\\").replace(":", "\\:")
    path.write_text(f"elsewhere:*:*:{GUARDED}:other\n*:*:*:{GUARDED}:{escaped}\n")
    with Register(guarded) as register:
        assert register.sensors() == ()
        assert PASSWORD not in register.address
    path.unlink()
    assert PASSWORD not in refusal(guarded)
    monkeypatch.setenv("PGPASSWORD", PASSWORD)
    with Register(guarded) as register:
        assert register.sensors() == ()


def test_a_file_that_is_no_database_is_refused_and_left(tmp_path: Path):
    path = tmp_path / "text.db"
    path.write_text("no database at all, but longer than a hundred bytes " * 4)
    assert f"sqlite:///{path}: " in refusal(str(path))
    assert path.read_text().startswith("no database")
    assert str(tmp_path) in refusal(str(tmp_path))
    assert "cannot be opened" in refusal(str(tmp_path / "none" / "r.db"))
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize("create", [False, True])
def test_a_name_that_is_too_long_is_one_line(tmp_path: Path, create: bool):
    calibration = parse(json.dumps(content(DRIFTING, 0.0, np.random.default_rng(1))), "first")
    with refused(InputError, key="--register") as refusal:
        Register(str(tmp_path / ("x" * 300)), create=create).enter_calibrations([calibration])
    assert str(refusal.value).isprintable()
    assert not list(tmp_path.iterdir())


def test_a_cut_register_is_one_line(tmp_path: Path):
    path = tmp_path / "r.db"
    with Register(str(path)) as register:
        register.enter_calibrations(ten(tmp_path))
    path.write_bytes(path.read_bytes()[: 4096 * 5])
    with refused(InputError, file=path, key="--register"), Register(str(path)) as register:
        register.calibrations()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_is_one_line(tmp_path: Path):
    folder = tmp_path / "closed"
    folder.mkdir()
    with Register(str(folder / "r.db")) as register:
        assert register.sensors() == ()
    folder.chmod(0o500)
    try:
        assert "cannot be opened" in refusal(str(folder / "other.db"))
        with Register(str(folder / "r.db")) as register:
            assert register.sensors() == ()
    finally:
        folder.chmod(0o700)


def test_a_file_that_cannot_be_written_is_read_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = tmp_path / "r.db"
    with Register(str(path)) as register:
        register.enter_calibrations(ten(tmp_path))
    connect = sqlite3.connect

    def read_only(*_: object, **options: object) -> sqlite3.Connection:
        return connect(f"file:{path}?mode=ro", uri=True, check_same_thread=False)

    monkeypatch.setattr("sqlite3.dbapi2.connect", read_only)
    with Register(str(path)) as register:
        assert len(register.calibrations()) == 10
        new = write(tmp_path / "new.json", content(DRIFTING, 7.0, np.random.default_rng(2)))
        with refused(InputError, file=path, key="--register"):
            register.enter_calibration(new)


def test_what_is_missing_for_a_register_is_said(monkeypatch: pytest.MonkeyPatch):
    for name in [name for name in sys.modules if name.startswith("inercal.laboratory.store")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "sqlalchemy", None)
    with refused(InputError) as refusal:
        import_module("inercal.laboratory.store")
    assert "inercal[store]" in str(refusal.value)


SECRETS = (
    "postgresql:/ada:secret@h/db",
    "postgresql//ada:secret@h/db",
    "postgresql:ada:secret@h/db",
    "postgres:ada:secret@h",
    "ada:secret@h/db",
    "//ada:secret@h/db",
    "postgresql/ada:secret@h/db",
    "://ada:secret@h/db",
    "postgresql+psycopg2://ada:secret@h/db",
    "ada:secret@h://db",
    "host=h user=ada password=secret dbname=db",
    "dbname=db password = 'secret'",
    "sqlite:///ada:secret@h/db",
    "postgresql://127.0.0.1:1/lab?Password=secret",
    "postgresql://127.0.0.1:1/lab?options=-c%20x=secret",
    "postgresql://127.0.0.1:1/lab?PASSFILE=secret",
    "postgresql://127.0.0.1:1/host=h password=secret",
    "postgresql://127.0.0.1:1/ada:secret@h",
)


@pytest.mark.parametrize("address", SECRETS)
def test_a_mistyped_password_is_not_printed_and_names_no_file(
    address: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(tmp_path)
    paths = ten(tmp_path)[:1]
    monkeypatch.setenv("INERCAL_REGISTER", address)
    for arguments in (["list", "--register", address], ["list"], ["import", str(paths[0])]):
        monkeypatch.setattr("sys.argv", ["inercal", "store", *arguments])
        with pytest.raises(SystemExit) as stop:
            main()
        printed = capsys.readouterr()
        assert stop.value.code == 2
        assert printed.err.count("\n") == 1
        assert "secret" not in printed.out + printed.err
    assert not [path for path in tmp_path.rglob("*") if "secret" in path.name]
    assert "secret" not in repr(InputError(printed.err))


def test_a_file_of_a_name_like_an_address_is_written_with_its_folder(tmp_path: Path):
    for name in ("./a:b@c.db", "postgres.db", "postgres/a.db", str(tmp_path / "a:b@c=d.db")):
        assert resolve_address(name).file is not None

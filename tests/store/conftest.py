"""Fixtures of the register's tests: an empty register in SQLite, and on a PostgreSQL server."""

import os
import pwd
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from uuid import uuid4

import psycopg
import pytest
from psycopg.sql import SQL, Identifier

_OWNER = "postgres"  # initdb refuses root: this user has the server then
GUARDED, PASSWORD = "guarded", "se:cr@et\\x"  # the one user whom the server asks for a password


@pytest.fixture(scope="session")
def server() -> Iterator[str]:
    """Give the folder of the socket of a PostgreSQL server of our own, with no network."""
    programs = _programs()
    # A socket's path takes 107 bytes at most: not below pytest's folder.
    with tempfile.TemporaryDirectory(prefix="inercal-pg-", ignore_cleanup_errors=True) as folder:
        user = _user(folder)
        data = f"{folder}/data"
        environment = {"PATH": os.environ["PATH"], "LC_ALL": "C.UTF-8"}

        def run(program: str, *arguments: str) -> None:
            subprocess.run(
                [programs / program, "--pgdata", data, *arguments],
                user=user,
                cwd=folder,
                env=environment,
                check=True,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )

        run("initdb", "--username=inercal", "--auth=trust", "--encoding=UTF8", "--no-sync")
        hba = Path(data, "pg_hba.conf")
        hba.write_text(f"local all {GUARDED} scram-sha-256\n{hba.read_text()}")
        options = f"-c listen_addresses='' -c unix_socket_directories='{folder}' -c fsync=off"
        run("pg_ctl", "start", "--wait", "--log", f"{folder}/log", "--options", options)
        try:
            yield folder
        finally:
            run("pg_ctl", "stop", "--mode=immediate")


def _programs() -> Path:
    """Return the folder of the server's programs."""
    found = shutil.which("pg_ctl")
    folders = [Path(found).resolve().parent] if found else []
    folders += sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)
    for folder in folders:
        if (folder / "initdb").exists() and (folder / "pg_ctl").exists():
            return folder
    pytest.skip("no PostgreSQL server: no pg_ctl in PATH or /usr/lib/postgresql")


def _user(folder: str) -> str | None:
    """Return who has the server; the folder is theirs then."""
    if os.geteuid() != 0:
        return None
    try:
        owner = pwd.getpwnam(_OWNER)
    except KeyError:
        pytest.skip(f"a PostgreSQL server does not run as root, and there is no user {_OWNER}")
    os.chown(folder, owner.pw_uid, owner.pw_gid)
    return _OWNER


@pytest.fixture
def database(server: str) -> Iterator[str]:
    """Give the address of an empty database of the server."""
    name = f"r{uuid4().hex[:12]}"
    about = f"host={server} user=inercal"
    with psycopg.connect(f"{about} dbname=postgres", autocommit=True) as connection:
        connection.execute(SQL("CREATE DATABASE {}").format(Identifier(name)))
        yield f"postgresql://inercal@/{name}?host={server}"
        connection.execute(SQL("DROP DATABASE {} WITH (FORCE)").format(Identifier(name)))


@pytest.fixture
def guarded(server: str, database: str) -> str:
    """Give the address of a register whose user needs `PASSWORD`."""
    name = database.partition("@/")[2].partition("?")[0]
    with psycopg.connect(f"host={server} user=inercal dbname={name}", autocommit=True) as one:
        # Users belong to the server: the second test of a session finds it.
        if not one.execute("SELECT FROM pg_roles WHERE rolname = %s", [GUARDED]).fetchall():
            one.execute(
                SQL("CREATE ROLE {} LOGIN PASSWORD {}").format(Identifier(GUARDED), PASSWORD)
            )
        one.execute(SQL("GRANT ALL ON SCHEMA public TO {}").format(Identifier(GUARDED)))
    return database.replace("inercal@", f"{GUARDED}@")


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.slow)])
def address(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Give the address of a register that is not there yet."""
    if request.param == "sqlite":
        return str(tmp_path / "register.db")
    return request.getfixturevalue("database")

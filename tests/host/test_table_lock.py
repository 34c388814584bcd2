"""One table, one program: the lock by whatever address, and what a refused run leaves."""

import os
import signal
import subprocess
import sys
from getpass import getuser
from pathlib import Path

import pytest
from tests.host.simulated_runs import carried_out, plan
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.host import devices, run_log, table_lock
from inercal.host.addresses import table_places
from inercal.host.bench_simulator import BenchSimulator
from inercal.host.table_lock import TableLock

HOLD = """
import sys
from getpass import getuser
from inercal.host.table_lock import TableLock
with TableLock(sys.argv[1], "run first"):
    print("locked", flush=True)
    sys.stdin.read()
"""
ADDRESS = "pmac://localhost:1?motors=1&counts=1000"


@pytest.fixture(autouse=True)
def own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep the tests' lock files from those of the machine and of the user."""
    (tmp_path / "machine").mkdir()
    (tmp_path / "machine").chmod(0o1777)
    monkeypatch.setattr(table_lock, "_SHARED_FOLDERS", (str(tmp_path / "machine"),))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "user"))
    monkeypatch.setattr(run_log, "_LOCK_TIMEOUT", 0.0)


@pytest.mark.parametrize(
    "other",
    [
        "pmac://127.0.0.1:1?motors=3&counts=-500",
        "pmac://[::1]:1?motors=2&counts=1",
        "pmac://LOCALHOST:1?counts=1000&motors=1",
        "pmac://127.1:1?motors=1&counts=1000",
    ],
)
def test_a_table_is_locked_by_whatever_address_it_is_reached(other: str):
    with TableLock(ADDRESS, "run first"):
        with refused(InputError, names=(other,)) as error:
            TableLock(other, "run second")
        assert f"run first, by {getuser()} (process {os.getpid()})" in str(error.value)
    with TableLock(other, "run second"):
        pass


def test_other_tables_are_free_and_a_lock_that_is_let_go_leaves_no_file(tmp_path: Path):
    link, target = tmp_path / "by-id", tmp_path / "ttyUSB0"
    target.touch()
    link.symlink_to(target)
    serial = f"motor:serial:{link}?baud=9600"
    assert table_places(serial) == table_places(f"motor:serial:{target}")
    assert table_places("pmac://10.0.0.5") == table_places("pmac://10.0.0.5:1025?motors=1")
    with TableLock(ADDRESS, "a"), TableLock("pmac://localhost:2?m", "b"), TableLock(serial, "c"):
        assert len(list((tmp_path / "machine").iterdir())) == 3
        # Two readers of a serial port would take the replies from one another.
        with refused(InputError, names=(serial,)):
            devices.probe_table(serial)
    assert not [*(tmp_path / "machine").iterdir(), *(tmp_path / "user" / "inercal").iterdir()]


def test_the_users_own_lock_holds_where_temporary_folders_are_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    with TableLock(ADDRESS, "run first"):
        (tmp_path / "container").mkdir()
        (tmp_path / "container").chmod(0o1777)
        monkeypatch.setattr(table_lock, "_SHARED_FOLDERS", (str(tmp_path / "container"),))
        with refused(InputError, names=(ADDRESS,)):
            TableLock(ADDRESS, "run second")
    # Without a home to write to, the machine's lock is enough.
    monkeypatch.setenv("XDG_STATE_HOME", "/proc")
    with TableLock(ADDRESS, "run first"), refused(InputError, names=(ADDRESS,)):
        TableLock(ADDRESS, "run second")


def test_a_process_that_is_killed_frees_its_table():
    # The machine's own folders: the process knows no others. Port 3 is no other test's.
    address = ADDRESS.replace(":1?", ":3?")
    command = [sys.executable, "-c", HOLD, address]
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(table_lock, "_SHARED_FOLDERS", ("/run/lock", "/tmp"))
        holder = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        with holder:
            assert holder.stdout
            assert holder.stdout.readline() == b"locked\n"
            with refused(InputError, names=(address,)):
                TableLock(address, "run second")
            holder.send_signal(signal.SIGKILL)
        with TableLock(address, "run second"):
            pass


@pytest.mark.slow
def test_a_second_run_is_refused_leaves_nothing_and_disturbs_no_byte(tmp_path: Path):
    run = plan(tmp_path / "plan")
    refusals: list[str] = []
    with BenchSimulator(run.path, seed=1) as bench:

        def second(first: object) -> None:
            with pytest.raises(InputError) as error:
                carried_out(tmp_path / f"second-{len(refusals)}", bench, run)
            refusals.append(str(error.value))

        acts = [(label, "work", second) for label in ("y up", "z+", "rest")]
        first = carried_out(tmp_path / "first", bench, run, acts)
    with BenchSimulator(run.path, seed=1) as bench:
        undisturbed = carried_out(tmp_path / "alone", bench, run)
    assert first.done, first.words
    assert len(refusals) == 3
    assert all(f"run {tmp_path / 'first'}" in words for words in refusals)
    assert (tmp_path / "first" / "run.log").read_bytes() == (
        tmp_path / "alone" / "run.log"
    ).read_bytes()
    assert [s[0] for s in first.sections] == [s[0] for s in undisturbed.sections]

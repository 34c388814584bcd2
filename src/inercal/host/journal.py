"""The journal of a run: an SQLite file with its header, steps, events and files.

The raw log contains the bytes from the devices, and the journal contains the state of the run. If
the host was killed, the run can be resumed with both files: completed steps are kept, and the
interrupted step is repeated from the beginning.
"""

import os
import shutil
import sqlite3
from collections.abc import Generator, Mapping
from contextlib import closing, contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, Self

from inercal.basics.atomic_files import atomic_write
from inercal.basics.closeable import Closeable, on_failure
from inercal.basics.errors import InputError
from inercal.host.run_log import os_errors_as_input_errors

NOTE_LEVEL = "note"  # level of an event written by the operator
_VERSION = 1
_MOUNTED = "mounted"  # mark of a mounting in the table of sections
# A run in a chamber or with further IMUs has one more table, so that journals of other runs stay
# as they are.
_CHAMBER = "CREATE TABLE IF NOT EXISTS chamber (id INTEGER PRIMARY KEY, address TEXT NOT NULL)"
_FURTHER = (
    "CREATE TABLE IF NOT EXISTS further_imu (id INTEGER PRIMARY KEY, name TEXT, address TEXT)"
)
_SCHEMA = """
CREATE TABLE run (begun TEXT NOT NULL, run_file TEXT NOT NULL, table_address TEXT NOT NULL,
                  imu_address TEXT NOT NULL, clock_address TEXT NOT NULL, poll REAL NOT NULL,
                  steps INTEGER NOT NULL, state TEXT NOT NULL);
CREATE TABLE section (id INTEGER PRIMARY KEY, step INTEGER NOT NULL, label TEXT NOT NULL,
                      what TEXT NOT NULL, time REAL NOT NULL);
CREATE TABLE event (id INTEGER PRIMARY KEY, at TEXT NOT NULL, time REAL, level TEXT NOT NULL,
                    words TEXT NOT NULL);
CREATE TABLE file (name TEXT PRIMARY KEY, size INTEGER NOT NULL, sha256 TEXT NOT NULL);
"""


class JournalHeader(NamedTuple):
    """The header of a journal.

    Parameters
    ----------
    begun : str
        Time at which the run began, ISO 8601, UTC.
    run_file : str
        Name of the run file in the folder of the journal.
    table, imu, clock : str
        Addresses of the devices; `clock` is empty unless the bench is simulated.
    poll : float
        Time between two readings of the table, s.
    steps : int
    state : str
        "running", "interrupted", "carried out" (the table has finished) or "done" (calibrated). If
        the state is "running" but there is no host, the run was interrupted.
    """

    begun: str
    run_file: str
    table: str
    imu: str
    clock: str
    poll: float
    steps: int
    state: str

    @property
    def addresses(self) -> tuple[str, str, str]:
        """The addresses of table, IMU and clock."""
        return self.table, self.imu, self.clock


class JournalEvent(NamedTuple):
    """An event that the operator should know about.

    Parameters
    ----------
    at : str
        Time of the event, ISO 8601, UTC.
    time : float or None
        Run time, s.
    level : "info", "warning", "alarm" or "note"
        Level of the event; a "note" was written by the operator.
    words : str
    """

    at: str
    time: float | None
    level: str
    words: str


class Journal(Closeable):
    """An open journal; each call is one transaction.

    Data written by a call are kept even if the host is killed immediately afterwards. After a power
    failure, the journal is intact, but the latest entries may be missing, because a loop of 20 ms
    cannot wait for the disk.

    Parameters
    ----------
    path : path
    read_only : bool
        Whether nothing is written. The folder may then be a read-only archive.

    Raises
    ------
    InputError
        The file cannot be opened, is not a journal, or was written by a newer version.
    """

    def __init__(self, path: str | os.PathLike[str], *, read_only: bool = False):
        self.path = Path(path)
        if not self.path.exists():
            raise InputError(
                f"{path} does not exist: the folder contains no journal of a run; "
                "begin a run there or name another folder",
                file=self.path,
            )
        with _sqlite_errors_as_input_errors(self.path):
            self._db = _open_to_read(self.path) if read_only else sqlite3.connect(self.path)
            with on_failure(self._db.close):
                if not read_only:
                    # The write-ahead log is flushed at intervals. If the host is killed, the
                    # operating system writes its data to the disk later.
                    self._db.execute("PRAGMA journal_mode = WAL")
                    self._db.execute("PRAGMA synchronous = NORMAL")
                _require_version(self.path, self._db)

    @classmethod
    def create(
        cls,
        path: str | os.PathLike[str],
        run_file: str,
        addresses: tuple[str, str, str],
        poll: float,
        steps: int,
    ) -> Self:
        """Create a journal and open it; if the host is killed meanwhile, no partial file remains.

        Parameters
        ----------
        path : path
        run_file : str
            Name of the run file in the folder of the journal.
        addresses : tuple of str
            Addresses of table, IMU and clock.
        poll : float
            Time between two readings of the table, s.
        steps : int
            Number of steps in the plan.

        Raises
        ------
        InputError
            A journal already exists, or the folder is not writable.
        """
        if Path(path).exists():
            raise InputError(
                f"{path} exists already; resume that run or name another folder", file=Path(path)
            )
        row = (utc_now(), run_file, *addresses, poll, steps, "running")
        with (
            _sqlite_errors_as_input_errors(Path(path)),
            atomic_write(path) as temporary,
            closing(sqlite3.connect(temporary)) as db,
        ):
            db.executescript(f"BEGIN; {_SCHEMA} PRAGMA user_version = {_VERSION};")
            db.execute("INSERT INTO run VALUES (?, ?, ?, ?, ?, ?, ?, ?)", row)
            db.commit()
        return cls(path)

    def header(self) -> JournalHeader:
        """Return the journal's header."""
        row, *_ = self._rows("SELECT * FROM run") or [None]
        if row is None:
            raise InputError(
                "the journal is damaged because it names no run; restore it from a "
                "copy, or begin a new run"
            ).located(self.path)
        return JournalHeader(*row)

    def set_addresses(self, addresses: tuple[str, str, str]) -> None:
        """Record the current addresses of table, IMU and clock."""
        self._execute(
            "UPDATE run SET table_address = ?, imu_address = ?, clock_address = ?", *addresses
        )

    def chamber(self) -> str:
        """Return the address of the chamber; "" if the run has none."""
        if not self._rows("SELECT name FROM sqlite_master WHERE name = 'chamber'"):
            return ""
        ((address,),) = self._rows("SELECT address FROM chamber")
        return address

    def set_chamber(self, address: str) -> None:
        """Record the current address of the chamber."""
        self._execute(_CHAMBER)
        self._execute("INSERT OR REPLACE INTO chamber VALUES (1, ?)", address)

    def further_imus(self) -> dict[str, str]:
        """Return the addresses of the further IMUs by name, in their order."""
        if not self._rows("SELECT name FROM sqlite_master WHERE name = 'further_imu'"):
            return {}
        return dict(self._rows("SELECT name, address FROM further_imu ORDER BY id"))

    def set_further_imus(self, addresses: Mapping[str, str]) -> None:
        """Record the current addresses of the further IMUs by name, in their order."""
        self._execute(_FURTHER)
        for number, one in enumerate(addresses.items()):
            self._execute("INSERT OR REPLACE INTO further_imu VALUES (?, ?, ?)", number, *one)

    def set_state(self, state: str) -> None:
        """Record the state of the run; see `JournalHeader.state`."""
        self._execute("UPDATE run SET state = ?", state)

    def record_section(self, step: int, label: str, what: str, time: float) -> None:
        """Record that a section began, was completed or became void, at a table time in s."""
        self._execute(
            "INSERT INTO section (step, label, what, time) VALUES (?, ?, ?, ?)",
            step, label, what, time,
        )  # fmt: skip

    def completed_steps(self) -> int:
        """Return how many steps are complete; this is also the number of the next step."""
        ((following,),) = self._rows("SELECT max(step) + 1 FROM section WHERE what = 'done'")
        return following or 0

    def record_mounting(self, step: int, mounting: str, time: float) -> None:
        """Record that an operator confirmed a mounting before a step, at a table time in s."""
        self.record_section(step, mounting, _MOUNTED, time)

    def mounting(self) -> str:
        """Return the last confirmed mounting; "" if no mounting was confirmed."""
        found = self._rows(
            "SELECT label FROM section WHERE what = ? ORDER BY id DESC LIMIT 1", _MOUNTED
        )
        return found[0][0] if found else ""

    def record_event(self, level: str, words: str, time: float | None = None) -> None:
        """Record an event with its run time in s; level and words are as in `JournalEvent`."""
        self._execute(
            "INSERT INTO event (at, time, level, words) VALUES (?, ?, ?, ?)",
            utc_now(), time, level, words,
        )  # fmt: skip

    def events(self, after: int = 0) -> tuple[JournalEvent, ...]:
        """Return the events, oldest first, without the first `after` events."""
        rows = self._rows(
            "SELECT at, time, level, words FROM event WHERE id > ? ORDER BY id", after
        )
        return tuple(JournalEvent(*row) for row in rows)

    def record_file(self, name: str, size: int, sha256: str) -> None:
        """Record the size and the SHA-256 hash of a file of the run."""
        self._execute("INSERT OR REPLACE INTO file VALUES (?, ?, ?)", name, size, sha256)

    def files(self) -> dict[str, tuple[int, str]]:
        """Return the size and the SHA-256 hash of each file, by name."""
        rows = self._rows("SELECT name, size, sha256 FROM file ORDER BY name")
        return {name: (size, sha256) for name, size, sha256 in rows}

    def _rows(self, what: str, *values: object) -> list[tuple[Any, ...]]:
        with _sqlite_errors_as_input_errors(self.path):
            return self._db.execute(what, values).fetchall()

    def _execute(self, what: str, *values: object) -> None:
        with _sqlite_errors_as_input_errors(self.path), self._db:
            self._db.execute(what, values)

    def close(self) -> None:
        """Close the file."""
        self._db.close()


def _open_to_read(path: Path) -> sqlite3.Connection:
    """Return a connection that creates no additional file next to the journal.

    If another program has opened the journal or was killed, there is a write-ahead log next to the
    journal. In this case, a copy of both files is read.
    """
    log = path.with_name(f"{path.name}-wal")
    if not log.exists():
        return sqlite3.connect(f"{path.resolve().as_uri()}?immutable=1", uri=True)
    db = sqlite3.connect(":memory:")
    with os_errors_as_input_errors(path, "read"), TemporaryDirectory() as folder:
        copy = Path(shutil.copy(path, folder))
        with suppress(FileNotFoundError):  # the other program has just closed it
            shutil.copy(log, folder)
        with closing(sqlite3.connect(copy)) as copied:
            copied.backup(db)
    return db


def _require_version(path: Path, db: sqlite3.Connection) -> None:
    (version,) = db.execute("PRAGMA user_version").fetchone()
    if version != _VERSION:
        raise InputError(
            f"{path} is a journal of version {version}; this program reads version {_VERSION} "
            "only: use the program that wrote the journal",
            file=path,
            key="user_version",
        )


@contextmanager
def _sqlite_errors_as_input_errors(path: Path) -> Generator[None]:
    """Convert an SQLite error to a one-line `InputError` with the name of the file."""
    try:
        yield
    except sqlite3.Error as error:
        raise InputError(
            f"SQLite cannot use the journal: {error}; check that the file is a journal "
            "and that its folder is writable"
        ).located(path) from None


def utc_now() -> str:
    """Return the present time, ISO 8601 in UTC, to the millisecond."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")

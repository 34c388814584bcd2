"""The lock of a table: only one program at a time can command a table.

A table is identified by its network host and port or its serial port (`addresses.table_places`),
because several addresses can mean the same table. For each of these places, there are two lock
files. One is for all users of the machine. The other is in the user's home folder; it also works if
programs have different temporary folders, like services and containers, and if several machines
share the home folder.

The system releases a lock when its process ends for any reason. The lock cannot detect programs on
machines that share no folder, but `table_driver` detects the motion that they command.
"""

import json
import os
import socket
import sys
from contextlib import ExitStack, suppress
from functools import partial
from hashlib import sha256
from pathlib import Path
from stat import S_IWOTH
from tempfile import gettempdir

from inercal.basics.closeable import Closeable, on_failure
from inercal.basics.errors import InputError
from inercal.basics.process_settings import user_name
from inercal.host.addresses import table_places
from inercal.host.run_log import lock_file, os_errors_as_input_errors

_SHARED_FOLDERS = ("/run/lock", "/tmp")  # the first folder that is writable for all users is used
_SHARED_MODE = 0o666
_MAX_NOTE = 4096  # bytes


class TableLock(Closeable):
    """The exclusive right to command the table at an address, until `close` is called.

    Parameters
    ----------
    address : str
        Address of the table; see `inercal.host.addresses.open_table`.
    purpose : str
        Purpose for which the table is used, such as "run first". Others who are refused see this
        text.

    Raises
    ------
    InputError
        Another program has the lock, or a lock file cannot be created.
    """

    def __init__(self, address: str, purpose: str):
        with ExitStack() as opened:
            # On Windows, only the driver's own connection keeps other programs away.
            for place in table_places(address) if sys.platform != "win32" else ():
                name = f"inercal-table-{sha256(place.encode()).hexdigest()[:24]}.lock"
                shared = _shared_folder() / name
                with os_errors_as_input_errors(shared, "made"):
                    opened.enter_context(_LockFile(shared, address, purpose))
                # The home folder may be missing, read-only or on a disk without file locks.
                with suppress(OSError, RuntimeError):
                    own = _own_folder() / name
                    own.parent.mkdir(parents=True, exist_ok=True)
                    opened.enter_context(_LockFile(own, address, purpose))
            self._locks = opened.pop_all()

    def close(self) -> None:
        """Release the lock; other programs can then command the table."""
        self._locks.close()


class _LockFile(Closeable):
    """A file that this process has locked; `close` removes it."""

    def __init__(self, path: Path, address: str, purpose: str):
        self._path = path
        while True:
            self._file = _open(path)
            with on_failure(partial(os.close, self._file)):
                self._lock(address)
                if self._is_current():
                    break
            os.close(self._file)  # the previous owner of the lock removed the file
        with suppress(OSError):  # the disk may be full; the note is only for messages
            os.ftruncate(self._file, 0)
            note = [purpose, user_name(), os.getpid(), socket.gethostname()]
            os.pwrite(self._file, json.dumps(note).encode(), 0)

    def close(self) -> None:
        """Remove the file and release the lock."""
        with suppress(OSError):  # in a shared folder, it may belong to another user
            if self._is_current():
                self._path.unlink()
        os.close(self._file)

    def _lock(self, address: str) -> None:
        try:
            lock_file(self._file, self._path, "")
        except InputError:
            raise InputError(
                f"{address}: another program commands the table: {_read_note(self._file)}; wait "
                "until it has ended, or stop it",
                key="--table",
                names=(address,),
            ) from None

    def _is_current(self) -> bool:
        """Return whether the locked file is still the file at its path."""
        try:
            there = os.stat(self._path, follow_symlinks=False)
        except FileNotFoundError:
            return False
        return os.path.samestat(os.fstat(self._file), there)


def _open(path: Path) -> int:
    while True:
        # The first attempt does not use O_CREAT, because in a shared folder, systems refuse it for
        # another user's file.
        with suppress(FileNotFoundError):
            return os.open(path, os.O_RDWR | os.O_NOFOLLOW)
        with suppress(FileExistsError):
            file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, _SHARED_MODE)
            os.fchmod(file, _SHARED_MODE)  # regardless of the umask: other users also lock it
            return file


def _read_note(file: int) -> str:
    try:
        purpose, user, number, machine = json.loads(os.pread(file, _MAX_NOTE, 0))
    except (OSError, ValueError, TypeError):
        return "a process that has not said what it does"
    where = "" if machine == socket.gethostname() else f" on {machine}"
    return f"{purpose}, by {user} (process {number}{where})"


def _shared_folder() -> Path:
    """Return the folder for lock files that all users of the machine share."""
    for folder in _SHARED_FOLDERS:
        with suppress(OSError):
            if os.stat(folder).st_mode & S_IWOTH:
                return Path(folder)
    return Path(gettempdir())


def _own_folder() -> Path:
    """Return the folder for the user's lock files; raises `RuntimeError` without a home."""
    given = os.environ.get("XDG_STATE_HOME", "")
    state = Path(given) if os.path.isabs(given) else Path.home() / ".local" / "state"
    return state / "inercal"

"""Enters a run's folder in the register; if folder and register differ, the folder is right."""

from collections.abc import Generator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING

from inercal.basics.errors import InercalError, InputError
from inercal.host.journal import Journal, JournalHeader
from inercal.host.run_folder import JOURNAL, LOG, RunFolder
from inercal.host.run_log import file_sha256

if TYPE_CHECKING:  # a bench does not need a register
    from inercal.laboratory.store import Register, SensorHistory


def register_run(register: "Register", folder: str | Path) -> int:
    """Enter a run, its files and, if any, its calibration in the register; return the run's id.

    A run can be entered repeatedly. Existing entries are kept, and the state, the folder and the
    files are updated.

    Parameters
    ----------
    register : Register
    folder : path

    Raises
    ------
    InputError
        The folder contains no journal, a file of raw data differs from its entry in the journal, or
        the register is not writable. In these cases, nothing is entered.
    """
    from inercal.laboratory.store import RunFacts

    folder = Path(folder)
    with Journal(folder / JOURNAL, read_only=True) as journal:
        header, files = journal.header(), journal.files()
    result = RunFolder.open_existing(folder, header.run_file)
    facts = RunFacts(
        # A key that does not depend on the folder of the run.
        sha256(f"{header.begun}\n{header.run_file}\n{result.run.sha256}".encode()).hexdigest()[:32],
        result.run.sensor,
        result.run.kind.name,
        result.run.bench_name,
        header.begun,
        header.state,
        header.table,
        header.imu,
        str(folder.resolve()),
        _verified_files(result, header, files),
    )
    calibration = result.output_path("calibration.json")
    return register.enter_run(facts, calibration if calibration.exists() else None)


def _verified_files(
    made: RunFolder, header: JournalHeader, files: dict[str, tuple[int, str]]
) -> dict[str, tuple[int, str]]:
    """Return size and SHA-256 hash of the run's files, after verifying the raw data.

    The report and the calibration are not verified, because they may have been made again. The
    calibration contains its own hash.
    """
    found = dict(files)
    for name in (header.run_file, LOG, made.run.data.file):
        path = made.path / name
        if header.state == "running" or not path.is_file():
            continue  # the log of an active run is still growing
        now = path.stat().st_size, file_sha256(path)
        if found.setdefault(name, now) != now:
            raise InputError(
                f"{path} has changed since the run (its SHA-256 differs from that in the journal); "
                "restore the file",
                file=path,
            )
    return found


class RegisterSync:
    """Enters an active run in the register; if this fails, the run continues.

    Parameters
    ----------
    register : Register or None
        Register; if None, nothing is entered.
    folder : path

    Attributes
    ----------
    trouble : str
        Reason why the last attempt failed, and how to enter the run later; empty if it succeeded.
    """

    def __init__(self, register: "Register | None", folder: str | Path):
        self._register, self._folder = register, Path(folder)
        self.trouble = ""

    def update(self) -> None:
        """Enter the present state of the run."""
        if self._register is None:
            return
        try:
            register_run(self._register, self._folder)
            self.trouble = ""
        except InercalError as error:
            self.trouble = (
                f"the run is not in the register: {error}; enter it later by "
                f"`inercal store import {self._folder}`"
            )

    @contextmanager
    def background_work(self) -> Generator[None]:
        """Update the register in a separate thread, so that a slow server does not delay runs."""
        thread = Thread(target=self.update, daemon=True)
        thread.start()
        try:
            yield
        finally:
            thread.join()

    def history(self, sensor: str) -> "SensorHistory | None":
        """Enter the run's present state, and return its sensor's history; None without one."""
        self.update()
        if self._register is None or self.trouble:
            return None
        try:
            return self._register.history(sensor)
        except InercalError:
            return None

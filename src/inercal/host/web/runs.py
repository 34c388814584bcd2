"""All runs in one folder, whoever started them, and their entries in the register."""

import shutil
import signal
from datetime import datetime
from os import kill
from pathlib import Path
from typing import Any, NamedTuple

from inercal.basics.errors import InercalError, InputError
from inercal.basics.small_files import read_toml
from inercal.host.journal import Journal
from inercal.host.run_folder import JOURNAL
from inercal.host.run_log import is_locked
from inercal.host.web import run_request
from inercal.laboratory.store import Register

UNREADABLE = "unreadable"  # state of a run whose journal cannot be read


class StoredRun(NamedTuple):
    """A run that is stored in a folder.

    Parameters
    ----------
    path : Path
    stem : str
        First part of the names of the run file and of the results.
    summary : dict
        Summary for the page.
    """

    path: Path
    stem: str
    summary: dict[str, Any]

    @property
    def state(self) -> str:
        """The state in the header of the journal; "running" only if a process drives the run."""
        return self.summary["state"]

    def output_file(self, kind: str) -> Path:
        """Return the path of a result file of the run: "report.html" or "calibration.json"."""
        return self.path / f"{self.stem}.{kind}"


class Runs:
    """The runs stored in one folder.

    Parameters
    ----------
    folder : Path
    """

    def __init__(self, folder: Path):
        self.folder = folder

    def all(self) -> dict[str, StoredRun]:
        """Return the runs by the names of their folders; the latest comes first."""
        found = [_stored_run(journal.parent) for journal in self.folder.glob(f"*/{JOURNAL}")]
        found.sort(key=lambda one: one.summary["begun"], reverse=True)
        return {one.path.name: one for one in found}

    def find(self, name: str) -> StoredRun:
        """Return the run in the folder with a name; no other journal is opened.

        Raises
        ------
        InputError
            There is no such run.
        """
        journals = self.folder.glob(f"*/{JOURNAL}")
        found = next((one.parent for one in journals if one.parent.name == name), None)
        if found is None:
            raise InputError(f"there is no run {name[:80]!r}; GET /api/runs lists all runs")
        return _stored_run(found)

    def active_folders(self) -> list[Path]:
        """Return the folders of all active runs and manual sessions, whoever started them.

        The function reads no journal, because a stop must not depend on a journal.
        """
        names = (JOURNAL, run_request.MANUAL_JOURNAL)
        folders = dict.fromkeys(p.parent for name in names for p in self.folder.glob(f"*/{name}"))
        return [folder for folder in folders if run_request.run_in_progress(folder)]

    def manual_sessions(self) -> list[Path]:
        """Return the folders of active manual sessions."""
        return [one for one in self.active_folders() if (one / run_request.MANUAL_JOURNAL).exists()]

    def new_folder(self, stem: str) -> Path:
        """Return a path for the folder of a new run that does not exist yet."""
        name = f"{stem}-{datetime.now():%Y%m%d-%H%M%S}"
        result, count = self.folder / name, 1
        while result.exists():
            count += 1
            result = self.folder / f"{name}-{count}"
        return result

    def free_space(self) -> int:
        """Return the number of free bytes on the disk; 0 if the folder is gone."""
        try:
            return shutil.disk_usage(self.folder).free
        except OSError:
            return 0

    def require_room(self, needed: int) -> None:
        """Raise an error if the disk has too little free space for a run."""
        if (free := self.free_space()) < needed:
            raise InputError(
                f"the run needs about {needed / 1e6:.0f} MB, but only "
                f"{free / 1e6:.0f} MB are free on the disk: delete files, or serve another folder "
                "(option --runs)"
            ).located(self.folder)

    def stop(self, name: object) -> None:
        """Stop the run in the folder with a name, or all active runs if `name` is None."""
        there = [one for one in self.active_folders() if name in (None, one.name)]
        if not there:
            raise InputError("there is no active run to stop; reload the page to see all runs")
        reached = [_interrupt_process(one) for one in there]
        if not all(reached):
            raise InputError(
                "this page cannot stop the run: a terminal controls it; stop it there, or press "
                "the emergency stop"
            )

    def enter(self, register: str | None) -> list[str]:
        """Enter all inactive runs in the register; return descriptions of the failures.

        A run that is registered as done is skipped, because its raw data, which may be many
        gigabytes, were verified when it was entered.

        Raises
        ------
        InercalError
            The register cannot be opened.
        """
        from inercal.host.registration import register_run

        troubles: list[str] = []
        with Register(register) as opened:
            done = {(run.folder, run.begun) for run in opened.runs() if run.state == "done"}
            for name, one in self.all().items():
                known = (str(one.path.resolve()), one.summary["begun"]) in done
                if one.state in ("running", UNREADABLE) or known:
                    continue
                try:
                    register_run(opened, one.path)
                except InercalError as error:
                    troubles.append(f"{name}: {error}")
        return troubles


def _stored_run(path: Path) -> StoredRun:
    """Return the run in a folder; if its journal cannot be read, its summary states why."""
    stem, state, starting = "", UNREADABLE, False
    summary: dict[str, Any] = {"id": path.name, "sensor": path.name, "begun": "", "report": False}
    try:
        with Journal(path / JOURNAL, read_only=True) as journal:
            header = journal.header()
    except InputError as error:
        summary["trouble"] = str(error)
    else:
        stem = Path(header.run_file).stem
        starting = is_locked(path / header.run_file)  # no log yet, or its calibration is computed
        state = "interrupted" if header.state == "running" else header.state
        summary |= {"sensor": _sensor_name(path / header.run_file), "begun": header.begun}
        summary["report"] = (path / f"{stem}.report.html").is_file()
    summary["state"] = "running" if starting or run_request.run_in_progress(path) else state
    return StoredRun(path, stem, summary)


def _sensor_name(run_file: Path) -> str:
    """Return the name of the sensor in a run file; the rest is not checked."""
    try:
        return str(read_toml(run_file, "run file")["sensor"]["name"])
    except (InputError, KeyError, TypeError):
        return ""


def _interrupt_process(folder: Path) -> bool:
    """Send a stop signal to the process of a run in a folder; False if there is no process."""
    # If a record is not locked, it is old, and its process ID may now belong to another process.
    is_driven = is_locked(folder / run_request.PROCESS_RECORD)
    was = run_request.read_process_record(folder) if is_driven else None
    if was is None:
        return False
    try:
        kill(was.process, signal.SIGINT)
    except ProcessLookupError:
        pass  # the process has ended meanwhile
    except PermissionError:
        return False
    return True

"""The folders of the server: plans, which are run files, and runs, whoever started them.

If an operator changes filter parameters on the page, they are checked like the parameters in a run
file.
"""

import shutil
import signal
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from importlib.resources import files
from os import kill
from pathlib import Path
from typing import Any, NamedTuple

from inercal.basics.errors import InercalError, InputError
from inercal.basics.small_files import read_toml
from inercal.host.journal import Journal
from inercal.host.recording_writer import require_recordable
from inercal.host.run_folder import JOURNAL
from inercal.host.run_log import is_locked
from inercal.host.tasks import host_plan
from inercal.host.web import run_request
from inercal.host.web.json_objects import JsonObject, object_or_none
from inercal.laboratory.store import Register
from inercal.runfile import Run, read
from inercal.runfile.filter_fields import FILTER_KEY, filter_errors, filter_fields
from inercal.runfile.schema import RunSchema

_SECTIONS = frozenset(RunSchema.model_fields)
_DEMO = "demo"
_LOGGED_BYTES, _COLUMN_BYTES, _OTHER_COLUMNS = 64, 8, 4  # per sample
_OTHER_BYTES = 5_000_000  # report, calibration, journal
_HOMING_TIME = 60.0  # s; estimated time before the first step


@dataclass(frozen=True)
class Plan:
    """A run file that may be used as a plan.

    Parameters
    ----------
    path : Path
    summary : dict
        Summary for the page; `trouble` states why the file cannot be used as a plan.
    """

    path: Path
    summary: dict[str, Any]


class Plans:
    """The run files in a folder, which are read again when they change.

    Parameters
    ----------
    folder : Path
    """

    def __init__(self, folder: Path):
        self._folder = folder
        self._read: dict[Path, tuple[tuple[int, int], Plan | None]] = {}

    def all(self) -> dict[str, Plan]:
        """Return the plans by name."""
        found = {path.stem: path for path in sorted(self._folder.glob("*.toml"))}
        found.setdefault(_DEMO, Path(str(files("inercal").joinpath("demo.toml"))))
        result: dict[str, Plan] = {}
        for name, path in found.items():
            if (plan := self._plan(name, path)) is not None:
                result[name] = plan
        return result

    def get(self, name: object) -> Plan | None:
        """Return the plan with a given name; None if there is no such plan."""
        return self.all().get(name) if isinstance(name, str) else None

    def _plan(self, name: str, path: Path) -> Plan | None:
        try:
            status = path.stat()
        except OSError:
            return None
        now = status.st_mtime_ns, status.st_size
        was, plan = self._read.get(path, (None, None))
        if was != now:
            plan = _read_plan(name, path)
            self._read[path] = now, plan
        return plan


def _read_plan(name: str, path: Path) -> Plan | None:
    """Read the plan in a file; return None if the file is not a run file."""
    summary: dict[str, Any] = {
        "id": name, "file": path.name, "sensor": "", "steps": 0, "seconds": 0.0, "method": "",
        "bytes": 0,
        "trouble": "",
    }  # fmt: skip
    try:
        run = read(path)
        summary |= {"sensor": run.sensor.name, "method": run.method.name}
        require_recordable(run)
        plan = host_plan(run)
    except InputError as error:
        return Plan(path, summary | {"trouble": str(error)}) if _resembles_run_file(path) else None
    fields = {
        "steps": len(plan.tasks), "seconds": round(plan.seconds, 3), "bytes": expected_size(run),
        "spins": plan.spins, "filter": [asdict(field) for field in filter_fields(run)],
    }  # fmt: skip
    return Plan(path, summary | fields)


def expected_size(run: Run) -> int:
    """Return an upper estimate of the disk space that a run needs, in bytes.

    For each sample, there is a packet in the log and a row of numbers in the recording. A
    measurement with the 15-step plan from the tests (59 000 samples of six axes) gave 46 bytes per
    sample in the log, 90 bytes in the recording, and 1 MB for all other files.
    """
    plan = host_plan(run)
    columns = len(run.sensor.axes) + len(plan.bench.names) + _OTHER_COLUMNS
    a_sample = _LOGGED_BYTES + _COLUMN_BYTES * columns
    return int(_OTHER_BYTES + a_sample * (run.rate_hz or 0.0) * (plan.seconds + _HOMING_TIME))


def _resembles_run_file(path: Path) -> bool:
    """Return whether an invalid file was probably meant to be a run file."""
    try:
        return bool(_SECTIONS & read_toml(path).keys())
    except InputError:
        return path.is_file()


_MAX_CHANGES, _MAX_TEXT = 32, 40


def filter_changes(requested: object) -> Mapping[str, str] | None:
    """Return the requested changes, by key; None if there are no changes.

    Raises
    ------
    InputError
        The changes are not an object of short texts.
    """
    if requested is None:
        return None
    given: Mapping[str, Any] | None = object_or_none(requested)
    if given is None or len(given) > _MAX_CHANGES:
        raise InputError("filter: give an object with parameters and their values", key="filter")
    for key, text in given.items():
        if not (isinstance(text, str) and text.isprintable() and len(text) <= _MAX_TEXT):
            raise InputError(
                f"filter: {key[:_MAX_TEXT]}: enter at most {_MAX_TEXT} characters", key="filter"
            )
    return {key: text.strip() for key, text in given.items()} or None


def require_filter_changes(plan: Plan, changes: Mapping[str, str] | None) -> None:
    """Raise an error if changes would be invalid in the run file.

    Raises
    ------
    InputError
        A change is invalid. The message names the first such key and the problem.
    """
    for key, words in filter_errors(plan.path, changes).items() if changes else ():
        raise InputError(f"{FILTER_KEY} {key}: {words}".replace(" : ", ": "), key=key)


def check_filter_changes(plan: Plan | None, requested: JsonObject) -> dict[str, str]:
    """Return the problems with the requested changes, as texts by key.

    Raises
    ------
    InputError
        There is no such plan, or the changes are not an object of short texts.
    """
    if plan is None or plan.summary["trouble"]:
        raise InputError("choose a plan that can be run", key="plan")
    changes = filter_changes(requested.get("filter"))
    return filter_errors(plan.path, changes) if changes else {}


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

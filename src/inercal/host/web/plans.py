"""Lists the available plans: the run files in one folder, and that of the demonstration.

If an operator changes filter parameters on the page, they are checked like the parameters in a run
file.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from inercal.basics.errors import InputError
from inercal.basics.small_files import read_toml
from inercal.host.recording_writer import require_recordable
from inercal.host.tasks import host_plan
from inercal.host.web.json_objects import JsonObject, object_or_none
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

"""The folder of a run: the run file and its plan, the raw log, the journal and the results.

Files::

    plan.toml, path.csv   copies, from which a run is resumed even if the originals have changed
    run.log               the bytes that the devices sent
    run.journal           header, steps, events and files of the run (SQLite)
    recording.h5          written at the end under the name in [data]
    plan.calibration.json, plan.report.html
    NAME/                 run file, recording, calibration and report of the further IMU NAME
"""

import os
from collections.abc import Generator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from inercal.basics.atomic_files import atomic_write, require_plain_name
from inercal.basics.closeable import on_failure
from inercal.basics.errors import InputError, require_extra
from inercal.basics.small_files import read_toml
from inercal.host.addresses import layout_of_address
from inercal.host.assembly.imu_samples import ReceivedSamples
from inercal.host.assembly.table_polls import POLL_INTERVAL
from inercal.host.journal import Journal, JournalHeader
from inercal.host.recording_writer import require_recordable
from inercal.host.run_log import lock_file, os_errors_as_input_errors
from inercal.host.soaks import require_chamber
from inercal.host.tasks import host_plan, required_rate
from inercal.runfile import Run, read

LOG, JOURNAL = "run.log", "run.journal"
ALSO_IMU = "--also-imu"
_OUTPUT_KINDS = ("calibration.json", "report.html")


@dataclass(frozen=True)
class RunFolder:
    """The files of a run.

    Parameters
    ----------
    path : Path
    run : Run
        The run, read from the copy in the folder.
    """

    path: Path
    run: Run

    @classmethod
    def open_existing(cls, path: str | os.PathLike[str], run_file: str) -> "RunFolder":
        """Return the existing folder of a run; `run_file` is the name of the run file in it."""
        return cls(Path(path), read(Path(path) / run_file))

    @contextmanager
    def removed_on_failure(self, *more: str) -> Generator[None]:
        """If the block fails before the run, remove the files of `create_run`, and `more`.

        If a device does not answer, no files remain, and the name of the folder can be used again.
        """
        copied = (self.run.path.name, *_referenced_files(self.run.path))
        try:
            yield
        except BaseException:
            if not (self.log.exists() and self.log.stat().st_size):
                journal = (JOURNAL, f"{JOURNAL}-wal", f"{JOURNAL}-shm")
                for name in (LOG, *journal, *copied, *more):
                    (self.path / name).unlink(missing_ok=True)
                with suppress(OSError):  # a folder that existed before may contain other files
                    self.path.rmdir()
            raise

    @contextmanager
    def locked(self) -> Generator[None]:
        """Lock the run file in the folder during the block, so that others list the run as running.

        The log is only locked while the table moves, but the run also checks and calibrates.

        Raises
        ------
        InputError
            Another process has locked the run file, or it cannot be opened.
        """
        with os_errors_as_input_errors(self.run.path, "read"):
            file = self.run.path.open("rb+")
        with file:
            lock_file(file.fileno(), self.path, "another process drives this run; stop it first")
            yield

    @property
    def log(self) -> Path:
        """The path of the raw log."""
        return self.path / LOG

    @property
    def journal(self) -> Path:
        """The journal."""
        return self.path / JOURNAL

    @property
    def is_complete(self) -> bool:
        """Whether all files exist that are needed to resume the run."""
        try:
            steps = read(self.run.path).steps
        except InputError:  # a file that the run file names may also be missing
            return False
        return bool(steps) and self.log.is_file() and self.journal.is_file()

    def output_path(self, kind: str) -> Path:
        """Return the path of a result of the run: "calibration.json" or "report.html"."""
        return self.path / f"{self.run.path.stem}.{kind}"

    def create_further(self, sensor: str) -> "RunFolder":
        """Create the folder of a further IMU, with a run file for its sensor, and return it.

        Raises
        ------
        InputError
            A file cannot be read or written.
        """
        path = self.path / sensor
        with os_errors_as_input_errors(path, "made"):
            path.mkdir(exist_ok=True)
            for name in _referenced_files(self.run.path):
                with atomic_write(path / name) as temporary:
                    temporary.write_bytes((self.path / name).read_bytes())
            with atomic_write(path / self.run.path.name) as temporary:
                temporary.write_bytes(_renamed_run_file(self.run.path, sensor))
        return RunFolder.open_existing(path, self.run.path.name)


def create_run(
    path: str | os.PathLike[str],
    run: Run,
    addresses: tuple[str, str, str],
    poll: float = POLL_INTERVAL,
    content: bytes | None = None,
    chamber: str = "",
    further_imus: Mapping[str, str] | None = None,
) -> tuple[RunFolder, Journal]:
    """Create the folder of a run and its journal, before anything moves.

    The run file and the file with its path are copied to the folder.

    Parameters
    ----------
    path : path
    run : Run
    addresses : tuple of str
        Addresses of table, IMU and clock.
    poll : float
        Time between two readings of the table, s.
    content : bytes, optional
        Content of the copied run file, if it differs from the original.
    chamber : str
        Address of the temperature chamber; empty if there is none.
    further_imus : mapping of str to str, optional
        Addresses of further IMUs by the names of their sensors.

    Raises
    ------
    InputError
        The folder cannot be created, or it already contains a run or a file with the same name as a
        file of the run. The error is also raised if the run file does not describe a bench run or
        its plan cannot be carried out.
    """
    layout = layout_of_address(addresses[1])
    require_chamber(run, layout, chamber)
    require_recordable(run, layout)
    further = further_imus or {}
    _require_further_imus(run, addresses[1], further)
    path, name = Path(path), run.path.name
    prepare_folder(path)
    copied = name, *_referenced_files(run.path)
    result = (f"{run.path.stem}.{kind}" for kind in _OUTPUT_KINDS)
    for one in (*copied, LOG, run.data.file, *result, *further):
        if (path / one).exists():
            raise InputError(
                f"{path} already contains {one}; name another folder", file=path, names=(one,)
            )
    with os_errors_as_input_errors(path, "made"):
        for one in copied:
            given = content if one == name else None
            with atomic_write(path / one) as temporary:
                temporary.write_bytes(given or (run.path.parent / one).read_bytes())
    folder = RunFolder.open_existing(path, name)
    with folder.removed_on_failure(), folder.locked():
        journal = Journal.create(folder.journal, name, addresses, poll, len(host_plan(run).tasks))
        if chamber:
            journal.set_chamber(chamber)
        if further:
            journal.set_further_imus(further)
        config = folder.run.filter
        if config is not None and (changes := config.describe_changes(folder.run.estimator)):
            journal.record_event("info", f"filter keys changed: {changes}")
        return folder, journal


def prepare_folder(path: str | os.PathLike[str]) -> None:
    """Create the folder of a new run.

    Raises
    ------
    InputError
        The folder cannot be created, or already contains a run.
    """
    path = Path(path)
    require_plain_name(path)
    with os_errors_as_input_errors(path, "made"):
        if path.is_file():
            raise InputError(f"{path} is a file; name a folder", file=path)
        is_run = (path / JOURNAL).exists()
        path.mkdir(parents=True, exist_ok=True)
    if is_run:
        raise InputError(
            f"{path} already contains a run; name another folder, or continue this run by "
            f"`inercal bench resume {path}`",
            file=path,
            names=(JOURNAL,),
        )


def reopen_run(
    path: str | os.PathLike[str],
    addresses: tuple[str, str, str] = ("", "", ""),
    chamber: str = "",
    further_imus: Mapping[str, str] | None = None,
) -> tuple[RunFolder, Journal]:
    """Return the folder and the journal of an interrupted run.

    Parameters
    ----------
    path : path
    addresses : tuple of str
        Addresses of table, IMU and clock, if they have changed.
    chamber : str
        Address of the chamber, if it has changed.
    further_imus : mapping of str to str, optional
        Addresses of further IMUs by name, if they have changed.

    Raises
    ------
    InputError
        There is no run in the folder, the run is complete, an IMU's packets have changed, or a
        further IMU is new. The error is also raised if a run on a simulated bench is resumed
        without its clock, or a run on a real bench is resumed with a clock.
    """
    journal = Journal(Path(path) / JOURNAL)
    with on_failure(journal.close):
        was = journal.header()
        if was.state == "done":
            raise InputError(
                f"{path}: this run is complete; calibrate its recording by `inercal calibrate`",
                file=Path(path),
            )
        folder = RunFolder.open_existing(path, was.run_file)
        table, imu = addresses[0] or was.table, addresses[1] or was.imu
        _require_same_kind(path, was, table, addresses[2])
        _require_same_packets(Path(path), was.imu, imu, "--imu")
        further = journal.further_imus()
        for name, address in (further_imus or {}).items():
            if name not in further:
                possible = ", ".join(further) or "none"
                words = f"{path}: this run has no further IMU {name!r}; possible: {possible}"
                raise InputError(words, file=Path(path), key=ALSO_IMU, names=(name,))
            _require_same_packets(Path(path), further[name], address, ALSO_IMU)
        require_chamber(folder.run, layout_of_address(imu), chamber or journal.chamber())
        journal.set_addresses((table, imu, addresses[2] or was.clock))
        if chamber:
            journal.set_chamber(chamber)
        if further_imus:
            journal.set_further_imus(further | dict(further_imus))
    return folder, journal


def _require_same_packets(path: Path, was: str, address: str, option: str) -> None:
    """Raise an error if the packets at an address differ from those in the log."""
    before, after = (layout_of_address(one).name for one in (was, address))
    if before != after:
        raise InputError(
            f"{path}: its log contains packets of {before}, not {after}; give the same preset",
            file=path,
            key=option,
            names=(before, after),
        )


def _require_same_kind(
    path: str | os.PathLike[str], was: JournalHeader, table: str, clock: str
) -> None:
    """Raise an error if a simulated run would continue on a real bench, or vice versa."""
    words = ""
    if was.clock and not clock and table != was.table:
        words = "was begun on a simulated bench: give the clock's address as well as the table's"
    elif clock and not was.clock:
        words = f"was not begun on a simulated bench: resume it without --clock {clock}"
    if words:
        raise InputError(f"{path} {words}", file=Path(path), key="--clock")


def _referenced_files(run_file: Path) -> list[str]:
    """Return the files that a run file names, except the recording, which does not exist yet."""
    section = read_toml(run_file, "run file").get("method", {})
    names = [section.get(key) for key in ("path", "prior_file", "prior_type")]
    names += section.get("prior_from", {})
    files = [name for name in names if name is not None and (run_file.parent / name).is_file()]
    for name in files:
        if Path(name).parent != Path():
            raise InputError(
                f"[method] names {name}, but a run can only copy files from the folder "
                "of the run file; move this file to that folder",
                key="[method]",
                names=(name,),
            ).located(run_file)
    return files


def _require_further_imus(run: Run, imu: str, addresses: Mapping[str, str]) -> None:
    """Raise an error if the further IMUs of a new run cannot be recorded or calibrated.

    Parameters
    ----------
    run : Run
    imu : str
        Address of the main IMU.
    addresses : mapping of str to str
        Addresses of the further IMUs by name.

    Raises
    ------
    InputError
        A name cannot be the name of a folder or is the main sensor's, an address is used twice, or
        the packets do not match the run file.
    """
    for name, address in addresses.items():
        usable = name == Path(name).name and name not in (".", "..", run.sensor.name)
        if not usable or [imu, *addresses.values()].count(address) > 1:
            raise InputError(
                f"{ALSO_IMU} {name}={address}: give each IMU its own address, and its own name, "
                f"which must not be {run.sensor.name!r} and must be possible as a folder's name",
                key=ALSO_IMU,
                names=(name,),
            )
        ReceivedSamples(run.sensor, layout_of_address(address), required_rate(run))
        _renamed_run_file(run.path, name)


def _renamed_run_file(path: Path, sensor: str) -> bytes:
    """Return the content of a run file for another sensor of the type, without [sensor.truth]."""
    with require_extra("host", f"{ALSO_IMU} needs tomlkit", ("tomlkit",)):
        import tomlkit
    document = tomlkit.parse(path.read_text(encoding="utf-8")).unwrap()
    document["sensor"].pop("truth", None)
    document["sensor"]["name"] = sensor
    return tomlkit.dumps(document).encode()

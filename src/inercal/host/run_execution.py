"""Executes a run, from connecting devices to the final rest, for all user interfaces.

`finish_run` completes a run after its plan was carried out: it writes the recording, the
calibration and the report, and records their hashes.
"""

from collections.abc import Callable, Generator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from inercal.basics.errors import InercalError
from inercal.calibration.files import save
from inercal.host.addresses import DeviceAddresses, layout_of_address
from inercal.host.bench_run import SHOW_INTERVAL, BenchRun
from inercal.host.journal import NOTE_LEVEL, Journal
from inercal.host.live_estimator import LiveEstimator
from inercal.host.recording_writer import write_recording
from inercal.host.run_folder import RunFolder
from inercal.host.run_log import FURTHER_IMU, file_sha256
from inercal.host.tasks import DEFAULT_OPTIONS, RunOptions
from inercal.pipeline import Outcome, calibrate
from inercal.recordings.io.simulation_mark import SIMULATION_OF
from inercal.report import write_report


class RunInterrupted(InercalError):
    """The run was interrupted; `str(error)` states the reason.

    Parameters
    ----------
    reason : str
    can_be_resumed : bool, optional
        Whether the run can be resumed: its folder exists, and the devices' clocks can be related.
    """

    def __init__(self, reason: str, *, can_be_resumed: bool = True):
        super().__init__(reason)
        self.can_be_resumed = can_be_resumed


def execute_run(
    folder: RunFolder,
    journal: Journal,
    options: RunOptions = DEFAULT_OPTIONS,
    show: Callable[[BenchRun], None] | None = None,
    show_interval: float = SHOW_INTERVAL,
    run_context: Callable[[BenchRun], AbstractContextManager[object]] = nullcontext,
    background_work: Callable[[], AbstractContextManager[object]] = nullcontext,
) -> BenchRun:
    """Carry out the remaining steps of a plan with the devices in its journal; return the run.

    Parameters
    ----------
    folder : RunFolder
    journal : Journal
    options : RunOptions
    show : callable
        Function that is called with the run at intervals.
    show_interval : float
        Wall time between two calls of `show`, s.
    run_context : callable
        Function that is called with the run when its devices are connected. It returns a context
        manager that is active during the run.
    background_work : callable
        Function that returns a second context manager for the same time. It is closed after the
        table is at rest, so it may be slow.

    Raises
    ------
    RunInterrupted
        The run ended before its plan was complete.
    InercalError
        The run could not be started; see `BenchRun`.
    """
    addresses = DeviceAddresses(*journal.header().addresses)
    with (
        ExitStack() as after,
        BenchRun(folder, journal, addresses, options, show, show_interval) as run,
        run_context(run),
    ):
        after.enter_context(background_work())
        try:
            done = run.execute_plan()
        except InercalError as error:  # on a full disk, neither log nor journal can record the end
            raise _interrupted(str(error), folder, run) from error
    if not done:
        # `trouble` now includes the final messages.
        raise _interrupted(run.trouble, folder, run)
    return run


def _interrupted(reason: str, folder: RunFolder, run: BenchRun) -> RunInterrupted:
    """Return the exception for an interruption; its message also says how to continue."""
    if not folder.is_complete:
        advice = f"the folder {folder.path} or a file in it is gone, so the run cannot be resumed"
    elif run.needs_new_run:
        advice = "begin a new run"
    else:
        return RunInterrupted(reason, can_be_resumed=True)
    words = reason if advice in reason else f"{reason}; {advice}"
    return RunInterrupted(words, can_be_resumed=False)


if TYPE_CHECKING:
    from inercal.laboratory.store import SensorHistory


_LARGE_DIFFERENCE = 4.0  # standard deviations of the live estimate


class FinishedRun(NamedTuple):
    """The result of a run, its files by kind, and the result of each further IMU by name."""

    outcome: Outcome
    files: dict[str, str]
    further: dict[str, Outcome]


def finish_run(
    folder: RunFolder,
    journal: Journal,
    live: LiveEstimator | None = None,
    load_history: "Callable[[], SensorHistory | None]" = lambda: None,
    truth: Callable[[Outcome], Mapping[str, float]] | None = None,
) -> FinishedRun:
    """Write recording, calibration and report of a completed run, and record their hashes.

    Parameters
    ----------
    folder : RunFolder
    journal : Journal
    live : LiveEstimator, optional
        Live estimate. It is compared with the estimate from the recording, and the journal records
        how well they agree.
    load_history : callable, optional
        Function that returns the history of the sensor for the report; called after the calibration
        is written.
    truth : callable, optional
        Function that returns the true coefficients for the report, SI. By default, the run file
        states them.

    Returns
    -------
    FinishedRun
        A further IMU that cannot be calibrated is missing in it, and the journal says why.

    Raises
    ------
    InercalError
        The recording cannot be calibrated. The recording and the log are kept.
    """
    run = folder.run
    was = journal.header()
    about = {"table": was.table, "imu": was.imu, "begun": was.begun, "inercal": version("inercal")}
    # The log may be gigabytes long, so it is read only once for its hash.
    came = file_sha256(folder.log)
    layout = layout_of_address(was.imu)
    # Only a simulated bench has a clock address.
    simulation = f"{SIMULATION_OF}a bench with the clock {was.clock}" if was.clock else ""
    write = partial(write_recording, poll=was.poll, log_sha256=came, simulation=simulation)
    recording = write(run, layout, folder.log, folder.path, about)
    files = {"run_file": run.path, "log": folder.log, "recording": recording}
    _record_file(journal, folder.log, came)
    _record_file(journal, run.path)
    _record_file(journal, recording)
    # Before the first calibration, which may fail.
    others: dict[str, RunFolder] = {}
    for kind, (name, address) in enumerate(journal.further_imus().items(), start=FURTHER_IMU):
        with _errors_as_warnings(journal, name):
            one = folder.create_further(name)
            layout, told = layout_of_address(address), about | {"imu": address}
            path = write(one.run, layout, folder.log, one.path, told, imu_kind=kind)
            _record_file(journal, one.run.path)
            _record_file(journal, path)
            others[name], files[f"{name}/{path.name}"] = one, path
    outcome = _with_notes(calibrate(run), journal)
    if live is not None and live.has_estimate:
        _compare_live_estimate(journal, live, outcome, expected=run.method.final_by_recording)
    files["calibration_file"] = save(outcome.calibration, folder.output_path("calibration.json"))
    report = folder.output_path("report.html")
    true = run.truth if truth is None else truth(outcome)
    files["report"] = write_report(outcome, report, true or None, load_history())
    _record_file(journal, files["calibration_file"])
    _record_file(journal, files["report"])
    files["journal"] = folder.journal
    further: dict[str, Outcome] = {}
    for name, one in others.items():
        with _errors_as_warnings(journal, name):
            found = _with_notes(calibrate(one.run), journal)
            written = (
                save(found.calibration, one.output_path("calibration.json")),
                write_report(found, one.output_path("report.html")),
            )
            for path in written:
                _record_file(journal, path)
                files[f"{name}/{path.name}"] = path
            further[name] = found
    journal.set_state("done")
    return FinishedRun(outcome, {kind: str(path) for kind, path in files.items()}, further)


def _with_notes(outcome: Outcome, journal: Journal) -> Outcome:
    """Return the outcome with the operator's notes as conditions, labelled by run time."""
    notes = {
        f"note {number}" + ("" if one.time is None else f", {one.time:.0f} s"): one.words
        for number, one in enumerate(
            (one for one in journal.events() if one.level == NOTE_LEVEL), start=1
        )
    }
    if not notes:
        return outcome
    conditions = {**outcome.calibration.conditions, **notes}
    return replace(outcome, calibration=replace(outcome.calibration, conditions=conditions))


@contextmanager
def _errors_as_warnings(journal: Journal, name: str) -> Generator[None]:
    """Record an error about a further IMU as a warning, because the run itself is complete."""
    try:
        yield
    except InercalError as error:
        journal.record_event("warning", f"{name} is not calibrated: {error}")


def _record_file(journal: Journal, path: Path, sha256: str | None = None) -> None:
    """Record the size and the hash of a file; the hash is computed unless it is given."""
    name = path.relative_to(journal.path.parent).as_posix()
    journal.record_file(name, path.stat().st_size, sha256 or file_sha256(path))


def _compare_live_estimate(
    journal: Journal, live: LiveEstimator, outcome: Outcome, *, expected: bool
) -> None:
    """Record how much the live estimate differs from the estimate from the recording.

    If `expected` is true, a difference is not a warning, because another estimator processes the
    recording.
    """
    names, value = outcome.estimate.names, outcome.estimate.value
    found = np.array([value[names.index(name)] for name in live.names])
    known = np.isfinite(live.values)
    if not known.any() or np.array_equal(live.values[known], found[known]):
        words = "the live estimate is identical to that of the recording"
        journal.record_event("info", words)
        return
    apart = np.abs(live.values - found)[known] / live.std[known]
    k = int(apart.argmax())
    name = [one for one, shown in zip(live.names, known, strict=True) if shown][k]
    journal.record_event(
        "info" if expected and apart[k] < _LARGE_DIFFERENCE else "warning",
        f"the live estimate differs from that of the recording by up to {apart[k]:.2g} of its "
        f"standard deviations ({name})",
    )

"""Executes a plan, from connecting the devices to rest, for terminal, page and demonstration."""

from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, nullcontext

from inercal.basics.errors import InercalError
from inercal.host.addresses import DeviceAddresses
from inercal.host.bench_run import SHOW_INTERVAL, BenchRun
from inercal.host.journal import Journal
from inercal.host.options import DEFAULT_OPTIONS, RunOptions
from inercal.host.run_folder import RunFolder


class RunInterrupted(InercalError):
    """The run was interrupted; `str(error)` is the reason.

    Parameters
    ----------
    reason : str
    can_be_resumed : bool, optional
        Its folder is there, and the clocks of the devices can still be matched.
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
    """Have what is left of a plan carried out, at the addresses of its journal; return the run.

    Parameters
    ----------
    folder : RunFolder
    journal : Journal
    options : RunOptions
    show : callable
        Called with the run, now and then.
    show_interval : float
        s of the wall's between two such calls.
    run_context : callable
        Returns, for the run when its devices are connected, what is entered while it goes on.
    background_work : callable
        Returns what is entered then too, and left when the table is at rest: it may take its time.

    Raises
    ------
    RunInterrupted
        It came to an end before the plan's.
    InercalError
        Nothing was begun; see `BenchRun`.
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
        except InercalError as error:  # of a full disk: neither log nor journal takes the end
            raise _interrupted(str(error), folder, run) from error
    if not done:
        raise _interrupted(run.trouble, folder, run)  # what was said of the end is in it by now
    return run


def _interrupted(reason: str, folder: RunFolder, run: BenchRun) -> RunInterrupted:
    """Return what is raised of an interruption, with what can be done."""
    if not folder.is_complete:
        advice = f"the folder {folder.path} or a file in it is gone, so the run cannot be resumed"
    elif run.needs_new_run:
        advice = "begin a new run"
    else:
        return RunInterrupted(reason, can_be_resumed=True)
    words = reason if advice in reason else f"{reason}; {advice}"
    return RunInterrupted(words, can_be_resumed=False)

"""Executes a plan, from connecting the devices to rest, for terminal, page and demonstration."""

from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, nullcontext

from inercal.errors import InercalError
from inercal.host.addresses import DeviceAddresses
from inercal.host.bench_run import SHOW_INTERVAL, BenchRun
from inercal.host.journal import Journal
from inercal.host.options import DEFAULT_OPTIONS, RunOptions
from inercal.host.run_folder import RunFolder


class RunInterrupted(InercalError):
    """The run was interrupted and can be resumed; `str(error)` is the reason."""


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
    Interrupted
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
            raise RunInterrupted(str(error)) from error
    if not done:
        raise RunInterrupted(run.trouble)  # what was said of the end is in it by now
    return run

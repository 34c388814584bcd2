"""A plan carried out from connecting to rest, whoever looks on: terminal, page or demonstration."""

from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, nullcontext

from inercal.errors import InercalError
from inercal.host.addresses import Addresses
from inercal.host.folder import Folder
from inercal.host.journal import Journal
from inercal.host.options import ORDINARY, Options
from inercal.host.run import SHOWN, BenchRun


class Interrupted(InercalError):
    """The run can go on later; `str(error)` is why it does not now."""


def carried_out(
    folder: Folder,
    journal: Journal,
    options: Options = ORDINARY,
    show: Callable[[BenchRun], None] | None = None,
    every: float = SHOWN,
    beside: Callable[[BenchRun], AbstractContextManager[object]] = nullcontext,
    meanwhile: Callable[[], AbstractContextManager[object]] = nullcontext,
) -> BenchRun:
    """Have what is left of a plan carried out, at the addresses of its journal; return the run.

    Parameters
    ----------
    folder : Folder
    journal : Journal
    options : Options
    show : callable
        Called with the run, now and then.
    every : float
        s of the wall's between two such calls.
    beside : callable
        Returns, for the run when its devices are connected, what is entered while it goes on.
    meanwhile : callable
        Returns what is entered then too, and left when the table is at rest: it may take its time.

    Raises
    ------
    Interrupted
        It came to an end before the plan's.
    InercalError
        Nothing was begun; see `BenchRun`.
    """
    addresses = Addresses(*journal.header().addresses)
    with (
        ExitStack() as after,
        BenchRun(folder, journal, addresses, options, show, every) as run,
        beside(run),
    ):
        after.enter_context(meanwhile())
        try:
            done = run.carry_out()
        except InercalError as error:  # of a full disk: neither log nor journal takes the end
            raise Interrupted(str(error)) from error
    if not done:
        raise Interrupted(run.trouble)  # what was said of the end is in it by now
    return run

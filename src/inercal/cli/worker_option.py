"""Options of verbs that repeat a computation many times: where it is done."""

import os
import sys

import typer

WORKERS = typer.Option(
    None, "--workers", help="Processes that compute (default: one a core); results are the same."
)
SCHEDULER = typer.Option(
    None,
    "--scheduler",
    "--cluster",
    help="Compute on a Dask cluster: tcp://HOST:PORT, tls://HOST:PORT, or local: this machine.",
)


def warn_of_root(scheduler: str | None) -> None:
    """Warn on standard error where work for several processes is handed out as root.

    Parameters
    ----------
    scheduler : str or None
        As the user states it.
    """
    from inercal.basics.parallel import LOCAL

    root = hasattr(os, "geteuid") and os.geteuid() == 0
    if scheduler is None or not root:
        return
    what = (
        "the processes that read the recordings are root's"
        if scheduler == LOCAL
        else "whoever reaches the scheduler can run code as root"
    )
    print(f"inercal: warning: run as root: {what}; start it as another user", file=sys.stderr)

"""Options of verbs that repeat a computation many times: where it is done."""

import typer

WORKERS = typer.Option(
    None, "--workers", help="Processes that compute (default: one a core); results are the same."
)
SCHEDULER = typer.Option(
    None,
    "--scheduler",
    "--cluster",
    help="Compute on a Dask cluster: tcp://HOST:PORT, tls://HOST:PORT, or local for a new one.",
)

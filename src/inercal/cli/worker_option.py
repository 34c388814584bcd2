"""The option `--workers` of verbs that repeat a computation many times."""

import typer

WORKERS = typer.Option(
    None, "--workers", help="Processes that compute (default: one a core); results are the same."
)

"""`inercal bench serve`: the live page, in a browser."""

from pathlib import Path
from typing import Annotated

import typer

from inercal.cli.bench_options import (
    CLOCK_HELP,
    PATIENCE_HELP,
    SPEED_HELP,
    TEMPERATURE_HELP,
    run_options,
)


def serve(
    plans: Annotated[Path, typer.Option(help="Folder of run files to choose from.")] = Path(),
    runs: Annotated[Path, typer.Option(help="Folder that takes the runs' folders.")] = Path("runs"),
    register: Annotated[
        str | None, typer.Option(help="The register: a path, sqlite:///… or postgresql://…")
    ] = None,
    table: Annotated[str, typer.Option(help="A table to choose, as `run` takes it.")] = "",
    imu: Annotated[str, typer.Option(help="An IMU to choose, as `run` takes it.")] = "",
    clock: Annotated[str, typer.Option(help=CLOCK_HELP)] = "",
    speed: Annotated[float | None, typer.Option(help=SPEED_HELP)] = None,
    patience: Annotated[float, typer.Option(help=PATIENCE_HELP)] = 120.0,
    temperature: Annotated[str, typer.Option(help=TEMPERATURE_HELP)] = "",
    host: Annotated[
        str, typer.Option(help="Address to listen at; another than this machine's needs a token.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="0: any that is free.")] = 8765,
    token: Annotated[
        str | None,
        typer.Option(envvar="INERCAL_TOKEN", help="That a browser must show; made if needed."),
    ] = None,
) -> None:
    """Serve the live page: set up, watch, pause, stop and resume runs in a browser.

    A run survives the page and this server. A software stop is no safety function.
    """
    from inercal.errors import InputError, require_extra

    runs_options = run_options(speed, patience, temperature)
    if not 0 <= port < 65536:
        raise InputError(f"--port {port}; possible: 0 to 65535")
    packages = ("starlette", "uvicorn", "websockets", "tomlkit")
    with require_extra("host", f"the live page needs {', '.join(packages)}", packages):
        from inercal.host.web.server import ServerOptions
        from inercal.host.web.server import serve as served
    served(ServerOptions(plans, runs, register, table, imu, clock, runs_options, host, port, token))

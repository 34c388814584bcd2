"""The `inercal` program. Verbs import what they run inside their function: help stays quick."""

import os
import sys

import typer
from typer.exceptions import TyperException

from inercal.cli import (
    apply_command,
    bench_commands,
    budget_command,
    calibrate_command,
    demo_command,
    plan_command,
    report_command,
    reproduce_command,
    simulate_command,
    store_commands,
)
from inercal.errors import InercalError

app = typer.Typer(
    name="inercal",
    help="Calibrate accelerometers and IMUs, with the uncertainty of every coefficient.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)
for verb in (
    demo_command,
    calibrate_command,
    plan_command,
    budget_command,
    simulate_command,
    apply_command,
    report_command,
    reproduce_command,
):
    app.command(verb.NAME)(verb.run)
app.add_typer(bench_commands.app, name=bench_commands.NAME)
app.add_typer(store_commands.app, name=store_commands.NAME)


@app.callback(invoke_without_command=True)
def _options(
    version: bool = typer.Option(False, "--version", help="Print the version and stop."),
) -> None:
    if version:
        from importlib.metadata import version as installed

        print(f"inercal {installed('inercal')}")
        raise typer.Exit


def main() -> None:
    """Run the program; an error of the input is one line on standard error and status 2."""
    # Matrices are small: threads of linear algebra would only wait for one another.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        status: int | None = app(standalone_mode=False)
        sys.exit(status or 0)
    except TyperException as error:
        if text := error.format_message():  # else it has printed the help
            print(f"inercal: {text} (see --help)", file=sys.stderr)
        sys.exit(error.exit_code)
    except InercalError as error:
        print(f"inercal: {error}", file=sys.stderr)
        sys.exit(2)
    except BrokenPipeError:
        sys.exit(0)  # the reader of the output closed the pipe
    except KeyboardInterrupt:
        print("inercal: stopped", file=sys.stderr)
        sys.exit(130)

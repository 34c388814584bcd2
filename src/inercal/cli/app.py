"""The `inercal` program. Verbs import what they run inside their function, after their checks.

Help, and the refusal of a mistyped run file, stay quick.
"""

import os
import sys
from typing import Any

import typer
from typer.core import TyperGroup
from typer.exceptions import TyperException

from inercal.basics.atomic_files import written_files
from inercal.basics.errors import InercalError
from inercal.basics.visible_text import visible_text
from inercal.cli import (
    apply_command,
    bench_commands,
    budget_command,
    bundle_command,
    calibrate_command,
    certificate_commands,
    compare_command,
    compile_command,
    control_command,
    demo_command,
    export_command,
    fleet_commands,
    import_command,
    init_command,
    measure_command,
    noise_command,
    plan_command,
    qualify_command,
    repeat_command,
    report_command,
    reproduce_command,
    self_check_command,
    show_command,
    simulate_command,
    store_commands,
)
from inercal.cli.streams import StandardStreams

_INTERRUPTED = 130  # the exit status, as of a shell


class _Verbs(TyperGroup):
    """Verbs whose interruption is one line; typer would end without a word."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            print("inercal: stopped", file=sys.stderr)
            raise typer.Exit(_INTERRUPTED) from None


app = typer.Typer(
    name="inercal",
    cls=_Verbs,
    help="Calibrate accelerometers and IMUs, with the uncertainty of every coefficient.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=True,
)
for verb in (
    demo_command,
    init_command,
    calibrate_command,
    show_command,
    compare_command,
    plan_command,
    measure_command,
    budget_command,
    noise_command,
    simulate_command,
    apply_command,
    repeat_command,
    qualify_command,
    control_command,
    export_command,
    import_command,
    report_command,
    bundle_command,
    reproduce_command,
    compile_command,
    self_check_command,
):
    app.command(verb.NAME)(verb.run)
app.add_typer(bench_commands.app, name=bench_commands.NAME)
app.add_typer(certificate_commands.app, name=certificate_commands.NAME)
app.add_typer(fleet_commands.app, name=fleet_commands.NAME)
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
    # To look for plugins, pydantic would read the metadata of all installed packages.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    streams = StandardStreams()
    with written_files() as written:
        status = _run()
    if (error := streams.output_error()) is not None:
        files = f"; wrote {', '.join(map(str, written))}" if written else ""
        print(
            f"inercal: standard output cannot be written: {error.strerror}{files}", file=sys.stderr
        )
        status = status or 2
    sys.exit(status)


def _run() -> int:
    """Run the program and return its exit status."""
    try:
        status: int | None = app(standalone_mode=False, prog_name="inercal")
        return status or 0
    except TyperException as error:
        if text := error.format_message():  # else it has printed the help
            text = " ".join(f"{text} {_missing_help(error, text)}".split())
            print(f"inercal: {visible_text(text)} (see --help)", file=sys.stderr)
        return error.exit_code
    except InercalError as error:
        print(f"inercal: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("inercal: stopped", file=sys.stderr)
        return _INTERRUPTED


def _missing_help(error: TyperException, text: str) -> str:
    """Return the help of a missing parameter, which names the possible values."""
    if not text.startswith("Missing "):
        return ""
    # A bracket is escaped for the markup of the help.
    return (getattr(getattr(error, "param", None), "help", None) or "").replace("\\[", "[")

"""The `inercal` program, its list of verbs and its handling of errors.

Only the module of the called verb is imported. It imports the modules for its work inside its
function, after checking its inputs. Help and errors in a run file therefore appear quickly.

A verb prints after its files are written. A closed pipe, a full disk or a character that the
terminal cannot show must not end the verb before its exit status is known.
"""

import codecs
import io
import os
import sys
from collections import UserDict
from importlib import import_module
from typing import TYPE_CHECKING, Any, TextIO

import typer
from typer.core import TyperGroup
from typer.exceptions import TyperException
from typer.main import get_group

from inercal.basics.atomic_files import written_files
from inercal.basics.errors import InercalError, missing_extra
from inercal.basics.visible_text import visible_text
from inercal.cli.options import flag

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer


# Replacements for characters that are not in the terminal's encoding.
_PLAIN = {
    "−": "-", "–": "-", "—": "-", "·": "*", "…": "...", "±": "+/-", "×": "x", "√": "sqrt",
    "°": "deg", "µ": "u", "μ": "u", "²": "2", "³": "3", "⁴": "4", "≤": "<=", "≥": ">=",
    "σ": "sigma", "χ": "chi", "ω": "omega", "Δ": "Delta", "‖": "|", "“": '"', "”": '"', "’": "'",
}  # fmt: skip


def _in_plain_characters(error: UnicodeError) -> tuple[str, int]:
    """Return the replacement for characters not in an encoding (a handler for `codecs`)."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    hidden = error.object[error.start : error.end]
    return "".join(_PLAIN.get(one, "?") for one in hidden), error.end


codecs.register_error("inercal-plain", _in_plain_characters)


class _LastingOutput(io.RawIOBase):
    """A raw output that discards bytes after the first error, and stores this error.

    Parameters
    ----------
    descriptor : int
    """

    def __init__(self, descriptor: int):
        self._descriptor = descriptor
        self.broken: OSError | None = None

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._descriptor

    def isatty(self) -> bool:
        return os.isatty(self._descriptor)

    def write(self, b: "ReadableBuffer", /) -> int:
        if self.broken is None:
            try:
                return os.write(self._descriptor, b)
            except OSError as error:
                self.broken = error
        return memoryview(b).nbytes


class StandardStreams:
    """Standard output and error of the program, protected against write errors.

    Streams that a test or another program has replaced are not changed.
    """

    def __init__(self):
        self._output: _LastingOutput | None = None
        if sys.stdout is sys.__stdout__:
            sys.stdout, self._output = _guarded(sys.stdout, 1)
        if sys.stderr is sys.__stderr__:
            sys.stderr, _ = _guarded(sys.stderr, 2)

    def output_error(self) -> OSError | None:
        """Return the write error on standard output, if any; a closed pipe is not an error."""
        if self._output is None:
            return None
        sys.stdout.flush()
        broken = self._output.broken
        return None if isinstance(broken, BrokenPipeError) else broken


def _guarded(stream: TextIO | None, descriptor: int) -> tuple[io.TextIOWrapper, _LastingOutput]:
    """Return a protected stream on the same descriptor, or one to nowhere if it was closed."""
    if stream is None:
        descriptor = os.open(os.devnull, os.O_WRONLY)
    else:
        stream.flush()
    raw = _LastingOutput(descriptor)
    text = io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding="utf-8" if stream is None else stream.encoding,
        errors="inercal-plain",
        line_buffering=descriptor == 2 or raw.isatty(),
    )
    return text, raw


_INTERRUPTED = 130  # the exit status, as in a shell


# The verb self-check is the function `run` in the module self_check_command, and so on.
_VERBS = """
    demo init calibrate show compare plan measure budget noise simulate apply predict repeat prior
    qualify
    control export import report bundle reproduce compile self-check
"""
_GROUPS = ("bench", "certificate", "fleet", "store")


class _Commands(UserDict[str, Any]):
    """Commands by verb; the module of a verb is imported when its command is first used."""

    def __getitem__(self, verb: str) -> Any:
        if self.data[verb] is None:
            single = typer.Typer()
            if verb in _GROUPS:
                single.add_typer(import_module(f"inercal.cli.{verb}_commands").app, name=verb)
            else:
                module = import_module(f"inercal.cli.{verb.replace('-', '_')}_command")
                single.command(verb)(module.run)
            self.data[verb] = get_group(single).commands[verb]
        return self.data[verb]


class _Verbs(TyperGroup):
    """Group of verbs that prints one line when interrupted, while typer would print nothing."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = _Commands(dict.fromkeys((*_VERBS.split(), *_GROUPS)) | self.commands)

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


@app.callback(invoke_without_command=True)
def _options(version: bool = flag("--version", "Print the version and exit.")) -> None:
    if version:
        from importlib.metadata import version as installed

        print(f"inercal {installed('inercal')}")
        raise typer.Exit


def main() -> None:
    """Run the program; an input error is one line on standard error and exit status 2."""
    # The matrices are small, so linear-algebra threads would only wait for one another.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Otherwise pydantic reads the metadata of all installed packages to look for plugins.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    streams = StandardStreams()
    with written_files() as written:
        status = _run()
    if (error := streams.output_error()) is not None:
        files = f"; wrote {', '.join(map(str, written))}" if written else ""
        print(f"inercal: cannot write to standard output: {error.strerror}{files}", file=sys.stderr)
        status = status or 2
    sys.exit(status)


def _run() -> int:
    """Run the program and return its exit status."""
    try:
        status: int | None = app(standalone_mode=False, prog_name="inercal")
        return status or 0
    except TyperException as error:
        if text := error.format_message():  # otherwise the help has been printed
            text = text.replace(": Value error, ", ": ")  # from the validator of a choice
            text = " ".join(f"{text} {_missing_help(error, text)}".split())
            print(f"inercal: {visible_text(text)} (see --help)", file=sys.stderr)
        return error.exit_code
    except (InercalError, ImportError) as error:
        shown = missing_extra(error) if isinstance(error, ImportError) else error
        if shown is None:
            raise
        print(f"inercal: {shown}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("inercal: stopped", file=sys.stderr)
        return _INTERRUPTED


def _missing_help(error: TyperException, text: str) -> str:
    """Return the help text for a missing parameter, which names the possible values."""
    if not text.startswith("Missing "):
        return ""
    # Brackets are escaped in the help because of its markup.
    return (getattr(getattr(error, "param", None), "help", None) or "").replace("\\[", "[")

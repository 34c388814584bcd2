"""The program within the process of a test."""

from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import pytest

from inercal.cli.app import main


class Ended(NamedTuple):
    """What a verb left: its exit status, standard output and standard error."""

    status: int
    output: str
    error: str


def run_program(*arguments: str | Path) -> Ended:
    """Run the program; status 2 comes with one line on standard error."""
    output, error = StringIO(), StringIO()
    with (
        pytest.MonkeyPatch.context() as patch,
        redirect_stdout(output),
        redirect_stderr(error),
    ):
        patch.setattr("sys.argv", ["inercal", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            main()
    ended = Ended(int(stop.value.code or 0), output.getvalue(), error.getvalue())
    assert ended.status != 2 or ended.error.count("\n") == 1, ended.error
    return ended

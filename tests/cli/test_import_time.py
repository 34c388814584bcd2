"""Start-up has a budget: in units of what NumPy takes, which is measured on the same machine."""

import os
import resource
import subprocess
import sys

import pytest

REPEAT = 3
IMPORT, HELP, CALIBRATE = 0.6, 4.5, 8.0  # times the import of NumPy; 0.3, 2.7 and 5.1 when set


def processor_time(code: str) -> float:
    """Return the least processor time of several processes that run this code, s."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    spent: list[float] = []
    for _ in range(REPEAT):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(
            [sys.executable, "-c", code], env=environment, capture_output=True, check=True
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(spent)


@pytest.fixture(scope="module")
def numpy_time() -> float:
    return processor_time("import numpy")


@pytest.mark.slow
def test_importing_inercal_takes_less_than_numpy(numpy_time: float):
    assert processor_time("import inercal") < IMPORT * numpy_time


@pytest.mark.slow
def test_what_calibrates_is_imported_within_its_budget(numpy_time: float):
    assert processor_time("from inercal import calibrate") < CALIBRATE * numpy_time


@pytest.mark.slow
def test_the_help_of_the_program_is_there_within_its_budget(numpy_time: float):
    code = (
        "import sys; sys.argv = ['inercal', '--help']\n"
        "from inercal.cli.app import main\n"
        "try: main()\n"
        "except SystemExit as stop: assert not stop.code"
    )
    assert processor_time(code) < HELP * numpy_time

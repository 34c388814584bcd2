"""The settings of the program's process: freed memory is kept; importing changes nothing."""

import ctypes
import subprocess
import sys

import pytest

FAULTS = """
import gc, resource, sys
import numpy as np
import inercal, inercal.__main__
from inercal.basics.process_settings import prepare_process

def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(20):
        np.full(6_000_000, 1.0)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

print(gc.get_threshold()[0], faults())
prepare_process()
faults()
print(gc.get_threshold()[0], faults())
"""


@pytest.mark.slow
@pytest.mark.skipif(
    sys.platform != "linux" or not hasattr(ctypes.CDLL(None), "mallopt"), reason="no glibc here"
)
def test_memory_that_arrays_free_is_kept_for_those_to_come():
    # Without huge pages, whose number depends on the machine.
    done = subprocess.run(
        [sys.executable, "-c", FAULTS],
        capture_output=True,
        text=True,
        check=True,
        env={"NUMPY_MADVISE_HUGEPAGE": "0", "PATH": ""},
    )
    before, after = ([int(one) for one in line.split()] for line in done.stdout.splitlines())
    assert after[0] > 10 * before[0]
    assert after[1] < 0.01 * before[1]


DIVISION = """
import numpy as np
from inercal.basics.process_settings import prepare_process
prepare_process()
np.ones(2) / np.zeros(2)
"""


@pytest.mark.parametrize("options", [[], ["-Wdefault"]])
def test_a_warning_of_numpy_reaches_only_those_who_ask_for_it(options: list[str]):
    command = [sys.executable, *options, "-c", DIVISION]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert ("RuntimeWarning" in done.stderr) == bool(options)

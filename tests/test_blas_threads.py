"""A function of small matrices has one thread of linear algebra, unless the user has chosen."""

import os
import subprocess
import sys

import pytest

CODE = """
import numpy as np, scipy.linalg
from threadpoolctl import threadpool_info, threadpool_limits
from inercal.basics.process_settings import with_one_thread

def threads():
    return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}

@with_one_thread
def inside():
    return threads()

threadpool_limits(limits=2, user_api="blas")
print(threads(), inside(), threads())
"""


@pytest.mark.slow
@pytest.mark.parametrize(("chosen", "inside"), [({}, "{1}"), ({"OMP_NUM_THREADS": "2"}, "{2}")])
def test_threads_are_limited_for_the_call_alone(chosen: dict[str, str], inside: str):
    environment = {name: one for name, one in os.environ.items() if "NUM_THREADS" not in name}
    done = subprocess.run(
        [sys.executable, "-c", CODE],
        capture_output=True,
        text=True,
        check=True,
        env=environment | chosen,
    )
    assert done.stdout.strip() == f"{{2}} {inside} {{2}}"

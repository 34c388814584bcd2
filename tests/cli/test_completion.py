"""Completion of verbs by the shell, as `inercal --install-completion` sets it up."""

import os
import subprocess
import sys

import pytest

START = "from inercal.cli.app import main; main()"


@pytest.mark.slow
def test_verbs_are_completed():
    environment = {
        **os.environ,
        "_INERCAL_COMPLETE": "complete_bash",
        "COMP_WORDS": "inercal ca",
        "COMP_CWORD": "1",
    }
    code = f"import sys; sys.argv[0] = 'inercal'; {START}"
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert done.stdout.split() == ["calibrate"]

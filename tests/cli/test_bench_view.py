"""What is shown of a run on standard error, and what becomes of the run when nobody reads it."""

import subprocess
import sys

RUN = """
from collections import deque
from types import SimpleNamespace

from inercal.cli.bench_view import run_display
from inercal.cli.app import StandardStreams

StandardStreams()
recorder = SimpleNamespace(events=0, recent_messages=deque([("info", "step 1")], maxlen=8))
run = SimpleNamespace(recorder=recorder, time=1.5)
with run_display() as show:
    input()
    for _ in range(3):
        recorder.events += 1
        show(run)
print("went on")
"""


def test_a_run_goes_on_when_nobody_reads_what_is_said_of_it():
    with subprocess.Popen(
        [sys.executable, "-c", RUN],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdin
        assert process.stdout
        assert process.stderr
        process.stderr.close()
        process.stdin.write("go\n")
        process.stdin.close()
        assert process.stdout.read() == "went on\n"
    assert process.returncode == 0

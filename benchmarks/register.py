"""The register with 10 000 calibrations of one sensor: what its verbs cost, start-up included."""

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from tempfile import TemporaryDirectory

import numpy as np

import inercal
from benchmarks import Row, Skipped
from inercal.calibration import Calibration
from inercal.laboratory.store import Register

COUNT = 10_000
AT_ONCE = 1_000
BEGIN = datetime(2010, 1, 1, tzinfo=UTC)
RUN_FILE = Path(__file__).parents[1] / "examples" / "six_position" / "run.toml"
LIMITS = {"list": 2.0, "show": 3.0, "history": 5.0}  # s, of CPU time


def rows() -> Iterator[Row | Skipped]:
    """Yield the CPU time of each verb that reads, beside its limit."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "register.db"
        first = inercal.calibrate(RUN_FILE).calibration
        with Register(str(path)) as register:
            for begin in range(0, COUNT, AT_ONCE):
                register.enter_calibrations(repeats(first, range(begin, begin + AT_ONCE)))
        for verb, limit in LIMITS.items():
            what = [] if verb == "list" else [first.sensor.name]
            seconds = cpu_time([verb, *what, "--register", str(path)])
            yield Row(f"store {verb}, {COUNT} calibrations", seconds, limit, "limit", "s")


def repeats(first: Calibration, numbers: range) -> list[Calibration]:
    """Return calibrations of one sensor, each of a recording and a day of its own."""
    rng = np.random.default_rng(numbers.start)
    errors = rng.multivariate_normal(np.zeros(first.values.size), first.covariance, len(numbers))
    return [
        replace(
            first,
            values=first.values + error,
            provenance={
                **first.provenance,
                "created": (BEGIN + timedelta(days=number)).isoformat(),
                "recording sha256": f"{number:064x}",
            },
        )
        for number, error in zip(numbers, errors, strict=True)
    ]


def cpu_time(arguments: Sequence[str]) -> float:
    """Return the CPU time of `inercal store` with these arguments, in a process of its own, s."""
    command = "from inercal.cli.app import main; main()"
    before = getrusage(RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, "-c", command, "store", *arguments],
        check=True,
        stdout=subprocess.DEVNULL,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )
    after = getrusage(RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

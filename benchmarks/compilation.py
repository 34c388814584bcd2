"""Processor time of the first run of an installation, which compiles, and of a run after it.

Two processes may compile at once; the times of both are summed. After `inercal compile` the first
run is held to the time of a next one.
"""

import shutil
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import inercal
from benchmarks import ROOT, Row
from benchmarks.start_up import processor_time

# Seconds: of the first run, and of the next one.
LIMITS = {"hand_held/simulated": (6.0, 3.5), "turntable/mimu": (12.0, 3.5)}
BEFOREHAND = "turntable/mimu"


def rows() -> Iterator[Row]:
    """Time the first and the second calibration of two simulated recordings."""
    for example, (first, later) in LIMITS.items():
        with TemporaryDirectory() as folder:
            verb, cache = _calibration(example, folder), str(Path(folder) / "cache")
            name = f"calibrate {example}"
            compiling = processor_time(*verb, NUMBA_CACHE_DIR=cache)
            yield Row(f"{name}, first run: compiles", compiling, first, "limit")
            loading = processor_time(*verb, NUMBA_CACHE_DIR=cache)
            yield Row(f"{name}, next run", loading, later, "limit")
    with TemporaryDirectory() as folder:
        installed = Path(inercal.__file__).parent
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(installed, Path(folder) / "inercal", ignore=ignored)
        processor_time("compile", PYTHONPATH=folder)
        own = processor_time(*_calibration(BEFOREHAND, folder), PYTHONPATH=folder)
        name = f"calibrate {BEFOREHAND}, first run after `inercal compile`"
        yield Row(name, own, LIMITS[BEFOREHAND][1], "limit")


def _calibration(example: str, folder: str) -> tuple[str | Path, ...]:
    """Return the command that calibrates a copy of an example in a folder, with its recording."""
    copy = shutil.copytree((ROOT / "examples" / example).parent, Path(folder) / "run")
    run = copy / f"{Path(example).name}.toml"
    processor_time("simulate", run)
    return ("calibrate", run, "--out", folder, "--no-report")

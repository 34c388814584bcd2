"""Processor time of the first run of an installation, which compiles, and of a run after it.

Two processes may compile at once; the times of both are summed.
"""

import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks import ROOT, Row
from benchmarks.start_up import processor_time

# Seconds: of the first run, and of the next one.
LIMITS = {"hand_held/simulated": (6.0, 3.5), "turntable/mimu": (12.0, 3.5)}


def rows() -> list[Row]:
    """Time the first and the second calibration of two simulated recordings."""
    result: list[Row] = []
    for example, (first, later) in LIMITS.items():
        with TemporaryDirectory() as folder:
            copy = shutil.copytree((ROOT / "examples" / example).parent, Path(folder) / "run")
            run, cache = copy / f"{Path(example).name}.toml", str(Path(folder) / "cache")
            processor_time("simulate", run)
            verb = ("calibrate", run, "--out", folder, "--no-report")
            name = f"calibrate {example}"
            compiling = processor_time(*verb, NUMBA_CACHE_DIR=cache)
            result.append(Row(f"{name}, first run: compiles", compiling, first, "limit"))
            loading = processor_time(*verb, NUMBA_CACHE_DIR=cache)
            result.append(Row(f"{name}, next run", loading, later, "limit"))
    return result

"""A turntable's calibration of 10, 60 and 600 minutes at 100 Hz: time, and memory without the data.

The recording and the result grow with the length; what else the calibration takes must not. The
allocations of NumPy are counted, so that pages which the process keeps do not enter.
"""

import csv
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks import ROOT, Duration, Row
from benchmarks.start_up import processor_time

LENGTHENED = (4, 29, 298)  # times the rests of the example: 10, 60 and 600 minutes
LIMIT = 150.0  # MB
GROWTH = 1.2  # times the length
MEASURE = """
import sys, tracemalloc
import inercal, inercal.pipeline
tracemalloc.start()
kept = inercal.calibrate(sys.argv[1])
held, most = tracemalloc.get_traced_memory()
print((most - held) / 1e6, kept.observations.track.time.size)
"""


def lengthened_run(folder: Path, times: int) -> Path:
    """Return the run file of the example whose rests last longer, with its recording."""
    shutil.copytree(ROOT / "examples" / "turntable", folder)
    path, run = folder / "path.csv", folder / "mimu.toml"
    with path.open(encoding="utf-8", newline="") as file:
        steps = list(csv.DictReader(file))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(steps[0]))
        writer.writeheader()
        for step in steps:
            seconds = step["seconds [s]"]
            writer.writerow(step | {"seconds [s]": seconds and f"{times * float(seconds):g}"})
    text = run.read_text(encoding="utf-8").replace("mimu.csv", "mimu.npz")
    run.write_text(text, encoding="utf-8")
    processor_time("simulate", run)
    return run


def memory(run: Path) -> tuple[float, int]:
    """Return the most memory without recording and result, MB, and the number of samples."""
    command = [sys.executable, "-c", MEASURE, str(run)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    most, samples = done.stdout.split()
    return float(most), int(samples)


def rows() -> list[Row]:
    """Measure the lengths; what a minute takes is counted from one to the next, without a start."""
    minutes: list[float] = []
    costs: list[Duration] = []
    most: list[float] = []
    with TemporaryDirectory() as folder:
        for times in LENGTHENED:
            run = lengthened_run(Path(folder) / str(times), times)
            verb = ("calibrate", run, "--out", run.parent, "--no-report")
            processor_time(*verb)  # the first may compile
            memory_needed, samples = memory(run)
            most.append(memory_needed)
            minutes.append(samples / 6000)
            costs.append(processor_time(*verb))
    name = f"turntable, {minutes[2]:.0f} min at 100 Hz"
    (first, second, third), (little, more, all_of_it) = minutes, costs
    to_scale = (more - little) * (third - second) / (second - first)
    return [
        Row(f"{name}: beyond {second:.0f} min", all_of_it - more, to_scale,
            f"{first:.0f} to {second:.0f} min, to scale", to_reach=1 / GROWTH),
        Row(f"{name}: memory without data and result", most[2], LIMIT, "limit", "MB"),
    ]  # fmt: skip

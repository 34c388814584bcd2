"""Correction of samples while they arrive: from a file, and at 1 kHz over a pseudo-terminal.

The file has 200 000 samples of six channels and is written as CSV. At 1 kHz, the program runs for a
minute by itself; its processor time is that after the first sample. The added latency of a sample
is the time from the write of its line to the arrival of its corrected line.
"""

import os
import pty
import select
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np

from benchmarks import Row, best
from inercal.calibration import Calibration
from inercal.calibration.files import load, save
from inercal.host.correction import LiveCorrection, LiveSummary
from inercal.host.correction.outputs import Output, csv_format
from inercal.host.correction.sources import Source
from inercal.host.correction.text_rows import TextRows, layout_of_file
from inercal.pipeline.live_correction import LiveCorrector
from inercal.runfile import read

SAMPLES = 200_000
PERIOD, SECONDS = 1e-3, float(os.environ.get("INERCAL_LIVE_SECONDS", "60"))
RUN_FILE = """
[sensor]
name = "imu"

[sensor.accelerometer]
unit = "g"

[sensor.gyro]
unit = "°/s"

[bench]
latitude = "48.1 °"

[data]
file = "samples.csv"
time = 1
accelerometer = [2, 3, 4]
gyro = [5, 6, 7]

[method]
name = "ferraris"
"""


def files(folder: Path) -> tuple[Path, Path]:
    """Write a calibration and a run file, and return their paths."""
    run_file, calibration_file = folder / "run.toml", folder / "imu.calibration.json"
    run_file.write_text(RUN_FILE, encoding="utf-8")
    sensor = read(run_file).sensor.with_coefficients("bias", "scale", "misalignment")
    p = len(sensor.coefficients)
    values = 0.01 * np.random.default_rng(0).normal(size=p)
    save(Calibration(sensor, values, 1e-12 * np.eye(p)), calibration_file)
    return calibration_file, run_file


def lines(count: int) -> list[str]:
    """Return lines of samples at 1 kHz."""
    readings = np.random.default_rng(1).normal(size=(count, 6)).round(5).tolist()
    return [f"{PERIOD * k:.3f}," + ",".join(map(str, row)) + "\n" for k, row in enumerate(readings)]


def from_file(calibration_file: Path, run_file: Path, source: Path) -> LiveSummary:
    """Correct a file and write CSV to another file."""
    run = read(run_file)
    corrector = LiveCorrector(load(calibration_file), run)
    parser = TextRows(run, str(source), layout_of_file(run, source))
    with source.with_suffix(".corrected").open("wb") as file:
        output = Output(csv_format(corrector.names), file.fileno())
        return LiveCorrection(corrector, Source(str(source)), parser, output).run()


def processor_seconds(process: int) -> float:
    """Return the processor time of a running process, s."""
    return 1e-9 * int(Path(f"/proc/{process}/schedstat").read_text().split()[0])


def over_a_terminal(calibration_file: Path, run_file: Path) -> tuple[list[float], float, str]:
    """Return the latencies, s, the processor time per second, and the summary of the program."""
    device, terminal = pty.openpty()
    command = [sys.executable, "-m", "inercal", "apply", str(calibration_file), str(run_file)]
    command += ["--stream", os.ttyname(terminal)]
    program = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert program.stdout is not None
    output = program.stdout.fileno()
    os.read(output, 1 << 16)  # the header, once the port is open
    os.write(device, b"\n")  # ends the first line, which the program takes to be truncated
    samples = lines(round(SECONDS / PERIOD))
    sent: list[float] = []
    latencies: list[float] = []
    start, used, rest = perf_counter(), processor_seconds(program.pid), b""
    while len(latencies) < len(samples):
        now = perf_counter()
        due = start + PERIOD * len(sent)
        if len(sent) < len(samples) and now >= due:
            sent.append(now)
            os.write(device, samples[len(sent) - 1].encode())
            continue
        wait = due - now if len(sent) < len(samples) else 5.0
        ready, _, _ = select.select([output], [], [], wait)
        if not ready and len(sent) == len(samples):
            break
        if ready:
            came = os.read(output, 1 << 16)
            arrived = perf_counter()
            *whole, rest = (rest + came).split(b"\n")
            latencies += [
                arrived - sent[round(float(one.split(b",")[0]) / PERIOD)] for one in whole
            ]
    share = (processor_seconds(program.pid) - used) / (perf_counter() - start)
    program.send_signal(2)
    _, said = program.communicate()
    os.close(device)
    os.close(terminal)
    return latencies, share, said.decode().strip().splitlines()[-1]


def rows() -> list[Row]:
    """Measure the speed from a file, and loss, latency and load at 1 kHz."""
    with tempfile.TemporaryDirectory() as name:
        calibration_file, run_file = files(Path(name))
        source = Path(name) / "samples.csv"
        source.write_text("".join(lines(SAMPLES)), encoding="utf-8")
        assert from_file(calibration_file, run_file, source).samples == SAMPLES
        speed = best(lambda: from_file(calibration_file, run_file, source))
        source.unlink()
        latencies, share, said = over_a_terminal(calibration_file, run_file)
    count = round(SECONDS / PERIOD)
    print(f"(live correction: {said})")
    kilo = f"1 kHz over a terminal for {SECONDS:g} s"
    return [
        Row("200 000 samples of a file, corrected to CSV", speed, 1.0, "limit"),
        Row(
            f"{kilo}: share of samples that arrived",
            count / max(len(latencies), 1),
            1.0,
            "limit",
            "",
        ),
        Row(f"{kilo}: median latency", 1e3 * median(latencies), 2.0, "limit", "ms"),
        Row(f"{kilo}: load of a core", 100 * share, 5.0, "limit", "%"),
    ]

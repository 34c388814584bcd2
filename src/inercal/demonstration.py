"""The demonstration: a MEMS IMU is simulated, calibrated from its recording, and judged."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np

from inercal.calibration.files import save
from inercal.errors import InputError
from inercal.io.atomic import atomic_write
from inercal.io.write import write_recording
from inercal.pipeline import Outcome, calibrate, named_as_in, simulate
from inercal.report import write_report
from inercal.runfile import read


@dataclass(frozen=True, eq=False)
class Demo:
    """The outcome, the truth in SI, the normalised error squared, and the files written."""

    outcome: Outcome
    truth: Mapping[str, float]
    nees: float
    files: Mapping[str, str]


def demo(folder: str | Path, seed: int = 0) -> Demo:
    """Simulate, write, calibrate from what was written, compare, report.

    Parameters
    ----------
    folder : path
        Made if need be; holds the run file, the recording, the calibration and the report.
    seed : int

    Raises
    ------
    InputError
        The folder cannot be made.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}") from None
    run_file = folder / "ferraris.toml"
    with atomic_write(run_file) as temporary:
        temporary.write_bytes(files("inercal").joinpath("demo.toml").read_bytes())
    run = read(run_file)
    recording = folder / run.data.file
    write_recording(named_as_in(run, simulate(run, seed)), recording)
    outcome = calibrate(run)
    calibration = save(outcome.calibration, folder / "ferraris.calibration.json")
    page = write_report(outcome, folder / "ferraris.report.html", run.truth)
    names = outcome.calibration.sensor.coefficients
    error = outcome.calibration.values - np.array([run.truth.get(name, 0.0) for name in names])
    nees = float(error @ np.linalg.solve(outcome.calibration.covariance, error)) / len(error)
    written = {
        "run_file": run_file,
        "recording": recording,
        "calibration_file": calibration,
        "report": page,
    }
    return Demo(outcome, run.truth, nees, {name: str(path) for name, path in written.items()})

"""A systematic calibration on a simulated bench, live and from the recording.

With `readback = false` the recording has no angle of the table, and no other method takes it.
"""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from tests.base_seeds import evidence

from inercal.host.bench_run import BenchRun
from inercal.host.bench_simulator import BenchSimulator
from inercal.host.preparation import precompile_run
from inercal.host.run_execution import finish_run
from inercal.host.run_folder import create_run
from inercal.runfile import read

EXAMPLE = Path(__file__).parents[2] / "examples" / "systematic" / "imu.toml"


ANGLES = {"outer", "middle", "inner"}


@pytest.mark.slow
@pytest.mark.parametrize("readback", [evidence(True), False], ids=["readback", "no readback"])
def test_a_run_on_the_bench_is_calibrated_without_angles(tmp_path: Path, readback: bool):
    text = EXAMPLE.read_text(encoding="utf-8")
    for old, new in (
        ("imu.csv", "recording.h5"),
        ('"50 Hz"', '"100 Hz"'),
        ('kind = "turntable"', f'kind = "turntable"\nreadback = {str(readback).lower()}'),
        ('path = "systematic"', 'path = "systematic"\nseconds = "10 s"'),
    ):
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "imu.toml"
    path.write_text(text, encoding="utf-8")
    run = read(path)
    with BenchSimulator(run.path, seed=1) as bench:
        addresses = bench.addresses
        folder, journal = create_run(tmp_path / "run", run, addresses, poll=0.05)
        with journal:
            precompile_run(folder.run)
            with BenchRun(folder, journal, addresses) as process:
                assert process.execute_plan(), process.trouble
                live = process.recorder.live_estimator
                assert live is not None
                assert live.has_estimate
                assert (process.recorder.navigation is not None) == readback
            outcome = finish_run(folder, journal, live).outcome
            said = [event for event in journal.events() if "live estimate differs" in event.words]
    assert [event.level for event in said] == ["info"]
    assert np.abs((live.values - outcome.calibration.values) / live.std).max() < 4
    calibration = outcome.calibration
    truth = np.array([run.truth.get(name, 0.0) for name in calibration.sensor.coefficients])
    error = calibration.values - truth
    # χ² with 30 degrees of freedom, 0.01 % and 99.99 %
    assert 8 < error @ np.linalg.solve(calibration.covariance, error) < 69
    assert len(outcome.observations.labels) == 19
    with h5py.File(folder.path / "recording.h5") as opened:
        file: Any = opened
        assert (set(file) & ANGLES == ANGLES) == readback
        assert ("angle" in file["bench"]) == readback
        assert readback or not set(file) & ANGLES
        assert readback or not set(file["bench"])

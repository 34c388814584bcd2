"""The stated field is the same in all runs at one place, so calibrations share its error."""

from pathlib import Path

import numpy as np
import pytest
from tests.magnetometer.hand_recordings import recording, scattered
from tests.magnetometer.hand_run_files import run_file

from inercal.pipeline.run_calibration import calibrate_run
from inercal.runfile import read


@pytest.mark.slow
def test_coefficients_follow_the_stated_field_as_its_shared_error_says(tmp_path: Path):
    rng = np.random.default_rng(1)
    recording(scattered(24, rng), rng).write(tmp_path / "log.csv")
    found = []
    for field in ("50 µT ± 0.2 µT", "50.2 µT ± 0.2 µT"):
        bench = {"gravity": "9.81 m/s² ± 1 mm/s²", "field": field, "hemisphere": "north"}
        path = run_file(tmp_path, {f"bench.{key}": f'"{text}"' for key, text in bench.items()})
        found.append(calibrate_run(read(path), advise=False).calibration)
    first, second = found
    (error,) = (one for one in first.shared or () if one.name == "field")
    assert error.std == pytest.approx(0.2e-6)
    change = second.values - first.values
    at = [k for k, name in enumerate(first.sensor.coefficients) if name[0] == "m"]
    assert error.covariance[at] / error.std == pytest.approx(change[at], rel=0.02, abs=1e-9)
    scale = first.sensor.coefficients.index("mx.scale")
    own = first.std[scale] ** 2 - (error.covariance[scale] / error.std) ** 2
    assert 0 < own < 0.3 * first.std[scale] ** 2

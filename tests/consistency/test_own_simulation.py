"""The same for inercal's simulation, whose bench and estimator share one declaration."""

from pathlib import Path

import numpy as np
import pytest

from inercal.benches.hand.reading import nominal_plan
from inercal.pipeline import simulate
from inercal.recordings.segments import average_sections, marks_from_labels
from inercal.runfile import read

RUN = """
[sensor]
name = "simulated"

[sensor.accelerometer]
unit = "g"
white = "100 µg/√Hz"

[sensor.gyro]
unit = "°/s"
white = "0.3 °/√h"

[sensor.truth]
"ax.k0" = "32 mg"
"ay.k1" = "-0.5 %"
"az.delta_p" = "22 ′"
"gx.scale" = "1.1 %"
"gy.delta_o" = "9 ′"
"gz.g_i" = "110 °/h/g"

[bench]
gravity = "9.81 m/s² ± 0.2 mm/s²"
latitude = "47 °"
tilt = "0.1 °"
turn_angle = "0.5 °"
turn_tilt = "0.3 °"

[data]
file = "none.csv"
rate = "25 Hz"

[method]
name = "METHOD"
"""
TRIALS = 100


@pytest.mark.slow
@pytest.mark.parametrize("method", ["six_position", "ferraris"])
def test_simulated_sessions_err_as_stated(tmp_path: Path, method: str):
    path = tmp_path / "run.toml"
    text = RUN.replace("METHOD", method)
    if method == "six_position":
        of_turns = ('"g', "turn_")  # of gyros and turns, which six positions have not
        text = "\n".join(line for line in text.splitlines() if not line.startswith(of_turns))
    path.write_text(text, encoding="utf-8")
    run = read(path)
    made = simulate(run, seed=4, trials=TRIALS)
    observations = average_sections(made, run.sensor, marks_from_labels(made), nominal_plan(run))
    estimate = run.method.estimator("ml")(observations, run.sensor, run.bench, nominal_plan(run))
    names = run.sensor.coefficients
    p = len(names)
    error = estimate.value[:, :p] - np.array([run.truth.get(name, 0.0) for name in names])
    covariance = estimate.covariance[:, :p, :p]
    nees = np.einsum("ti,ti->t", error, np.linalg.solve(covariance, error[..., None])[..., 0]) / p
    assert nees.mean() == pytest.approx(1, abs=4 * np.sqrt(2 / (p * TRIALS)))
    assert np.abs(error.mean(axis=0) / error.std(axis=0, ddof=1)).max() < 4 / TRIALS**0.5
    band = 4 * np.sqrt(2 / (estimate.dof * TRIALS))
    assert np.mean(estimate.chi2) / estimate.dof == pytest.approx(1, abs=band)

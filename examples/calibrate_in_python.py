"""Calibrate from a run file, look at the result, keep it, and use it."""

from pathlib import Path

import numpy as np

import inercal

run_file = Path(__file__).parent / "six_position" / "run.toml"
outcome = inercal.calibrate(run_file)
for line in outcome.verdict:
    print(line)

calibration = outcome.calibration
print("bias of x:", calibration.value("ax.k0"), "±", 2 * calibration.uncertainty("ax.k0"), "m/s²")
inercal.save(calibration, "six_position.calibration.json")
inercal.write_report(outcome, "six_position.report.html")

readings = np.array([[0.0123, -0.0041, 1.0021]])  # g, as the sensor states them
print("specific force:", calibration.correct(readings).f, "m/s²")

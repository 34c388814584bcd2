"""Calibrate from a run file, look at the result, keep it, and use it."""

from pathlib import Path

import numpy as np

import inercal
from inercal.basics.units import format_quantity

run_file = Path(__file__).parent / "six_position" / "run.toml"
outcome = inercal.calibrate(run_file)
for line in outcome.verdict.lines:
    print(line)

calibration = outcome.calibration
expanded = 2 * calibration.uncertainty("ax.k0")
print("bias of x, k = 2:", format_quantity(calibration.value("ax.k0"), expanded, "mg"))
inercal.save(calibration, "six_position.calibration.json")
inercal.write_report(outcome, "six_position.report.html")

readings = np.array([[0.0123, -0.0041, 1.0132]])  # g, as the sensor states them
print("specific force:", calibration.correct(readings).f.round(4), "m/s²")

"""Predict the error and the uncertainty of an accelerometer triad over temperature."""

from pathlib import Path

import numpy as np

import inercal

run_file = Path(__file__).parents[1] / "six_position" / "soaks.toml"
calibration = inercal.calibrate(run_file).calibration

g = 9.80665  # m/s²
celsius = np.array([-10.0, 20.0, 50.0])
found = calibration.predict(f=np.array([0.0, 0.0, g]), T=celsius + 273.15)
z = found.names.index("fz")
for j, t in enumerate(celsius):
    raw, expanded = found.raw_error[j, z] / g, found.expanded[j, z] / g
    share = found.groups["scale factor"][j, z]
    print(f"{t:.0f} °C: raw error {1e3 * raw:.2f} mg, U after correction {1e6 * expanded:.0f} µg,")
    print(f"    of which the scale factor contributes {100 * share:.0f} % of the variance")

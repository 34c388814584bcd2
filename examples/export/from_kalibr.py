"""A result of Kalibr, applied to a reading and written for Basalt."""

from pathlib import Path

import numpy as np

import inercal

folder = Path(__file__).parent
calibration = inercal.import_calibration(folder / "results-imucam.txt", "kalibr")
for note in calibration.notes:
    print(note)

# Readings of the accelerometers in m/s², then of the gyros in rad/s. Kalibr states no biases.
reading = np.array([[1.0, 2.0, 9.5, 0.1, -0.2, 0.3]])
motion = calibration.correct(reading)
print("f =", *(f"{x:.5f}" for x in motion.f[0]), "m/s²")
print("w =", *(f"{x:.6f}" for x in motion.w[0]), "rad/s")

noise = {
    "accelerometer_noise_density": 1e-3,
    "accelerometer_random_walk": 1e-4,
    "gyroscope_noise_density": 1e-4,
    "gyroscope_random_walk": 1e-5,
    "update_rate": 200.0,
}
made = inercal.export_calibration(calibration, "basalt", options=noise)
Path("imu.basalt.json").write_text(made.text, encoding="utf-8")
for one in made.losses:
    print(f"basalt does not hold {one.word}: {one.effect_text()}")

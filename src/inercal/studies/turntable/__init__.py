"""The study of Liu, Cui, Zhang and Xu: an IMU on a turntable by two Kalman filters in half an hour.

The paper prints bounds on the errors of one device, neither noise nor table, and its formulas are
lost in the copy at hand: a simulated table has to answer. Each module takes one question: what
comes out, and the section of the page that shows it. Its words, and the claims that it judges,
stand in the TOML file of the section's name.
"""

from inercal.studies.section import Say, Study
from inercal.studies.turntable import accuracy, duration, failures, states
from inercal.studies.turntable import trials as of_devices

SOURCE = (
    "Liu Zhiwei, Cui Min, Zhang Peng, Xu Wenwu, North University of China: fast calibration of a "
    "MIMU on a three-axis turntable with LabVIEW"
)
SHARE, FEWEST = 250, 6  # trials for one device, which is half an hour of samples; devices


def run(trials: int, seed: int, say: Say) -> Study:
    """Return the study; see `inercal.studies.reproduce`."""
    devices = max(trials // SHARE, FEWEST)
    found = of_devices.run(devices, seed, say)
    return Study(
        "turntable",
        "An IMU on a turntable by two Kalman filters",
        SOURCE,
        "Twelve coefficients of the gyros by comparing attitudes with a turning table's, twelve of "
        "the accelerometers by the velocity at rest: 24 in half an hour instead of three. What the "
        "paper prints is judged here by simulation, where the truth is known.",
        (
            ("Sensors, grade T", "0.1 °/√h, drift 0.5 °/h\n60 µg/√Hz, drift 15 µg, 200 s"),
            ("Devices, 1σ", "0.3 °/s, 10 mg\n5000 ppm, 15′"),
            ("Table, 1σ", "harmonics 2″, 1″, noise 0.5″\nright angles 2″, lean 5″\n"
             "azimuth 0.1°, 2 ms late"),
            ("Recording", "100 Hz, 23 min"),
            ("Monte Carlo", f"{devices} devices, seed {seed}"),
        ),
        (
            accuracy.section(found),
            duration.section(found),
            states.section(found),
            failures.section(found),
        ),
    )  # fmt: skip

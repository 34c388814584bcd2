"""The study of Liu, Cui, Zhang and Xu: an IMU on a turntable by two Kalman filters in half an hour.

The paper prints bounds on the errors of one device, neither noise nor table, and its formulas are
lost in the copy at hand: a simulated table has to answer. Each module takes one question: what
comes out, and the section of the page that shows it. Its words, and the claims that it judges,
stand in the TOML file of the section's name.
"""

from inercal.studies.section import Say, Study
from inercal.studies.turntable import accuracy, duration, failures, states
from inercal.studies.turntable import trials as of_devices
from inercal.studies.words import study_of

SHARE, FEWEST = 250, 6  # trials for one device, which is half an hour of samples; devices


def run(trials: int, seed: int, say: Say) -> Study:
    """Return the study; see `inercal.studies.reproduce`."""
    devices = max(trials // SHARE, FEWEST)
    found = of_devices.run(devices, seed, say)
    return study_of(
        __name__,
        (
            accuracy.section(found),
            duration.section(found),
            states.section(found),
            failures.section(found),
        ),
        devices=devices,
        seed=seed,
    )

"""Run the study of Liu, Cui, Zhang and Xu: an IMU on a turntable with two Kalman filters.

The paper prints bounds on the errors of one device but neither its noise nor the table's errors,
and its formulas are illegible in our copy, so the study simulates a table. Each module answers one
question and builds the section of the page about it. The text and the claims of a section are in
the TOML file with the section's name.
"""

from inercal.basics.parallel import Executor
from inercal.studies.study import MessageCallback, Study, build_study
from inercal.studies.turntable import printed_accuracy
from inercal.studies.turntable import turntable_trials as of_devices

TRIALS_PER_DEVICE = 250  # each device has half an hour of samples
MIN_DEVICES = 6


def run(trials: int, seed: int, say: MessageCallback, executor: Executor) -> Study:
    """Compute the study; see `inercal.studies.reproduce`."""
    devices = max(trials // TRIALS_PER_DEVICE, MIN_DEVICES)
    found = of_devices.run_filters(devices, seed, say, executor)
    return build_study(
        __name__,
        (
            printed_accuracy.accuracy_section(found),
            printed_accuracy.time_section(found),
            printed_accuracy.states_section(found),
            printed_accuracy.failures_section(found),
        ),
        devices=devices,
        seed=seed,
    )

"""The stated range of gyros that were turned by an angle is that of the rates reached."""

from pathlib import Path

import numpy as np
from tests.runfile.key_sweep import example, toml

from inercal.physics.plan import Turn
from inercal.pipeline import apply_data_columns, calibrate, simulate
from inercal.recordings.io.write import write_recording
from inercal.runfile import read


def test_the_range_after_turns_by_hand_is_that_of_the_samples(tmp_path: Path):
    content = example(
        "ferraris_simulated/run.toml",
        ("data", "rate", "25 Hz"),
        ("data", "file", "log.npz"),
        ("method", "seconds", "4 s"),
        ("method", "turn_seconds", "4 s"),
    )
    path = tmp_path / "run.toml"
    path.write_text(toml(content), encoding="utf-8")
    run = read(path)
    write_recording(apply_data_columns(run, simulate(run, 1)), run.file(run.data.file))
    outcome = calibrate(path)
    assert outcome.calibration.validity is not None
    assert outcome.recording is not None
    limits, sensor = outcome.calibration.validity.rate, outcome.calibration.sensor
    assert limits is not None
    columns = [outcome.recording.channels.index(n) for n in sensor.select_axes("w").channels]
    turns = {step.label for step in outcome.steps if isinstance(step, Turn)}
    reached = np.concatenate(
        [
            sensor.select_axes("w").to_si(outcome.recording.data[mark.start : mark.stop, columns])
            for mark in outcome.marks
            if mark.label in turns
        ]
    )
    means = outcome.observations.mean[
        :, [sensor.channels.index(n) for n in sensor.select_axes("w").channels]
    ]
    assert limits == (min(reached.min(), means.min()), max(reached.max(), means.max()))
    assert limits[1] > 1.2 * means.max()

"""A step of an accelerometer within one hand-held rest, and a hand that trembles without one."""

from pathlib import Path

import numpy as np
import pytest
from tests.accuracy import handheld
from tests.accuracy.generator import G0, mems

from inercal import calibrate
from inercal.pipeline import Outcome

RUN = """\
[sensor.accelerometer]
unit = "m/s²"
[sensor.gyro]
unit = "rad/s"
[bench]
gravity = "9.81 m/s² ± 0.2 mm/s²"
timebase = "1 ppm"
[data]
file = "log.csv"
time = "time"
accelerometer = ["acc_x", "acc_y", "acc_z"]
gyro = ["gyr_x", "gyr_y", "gyr_z"]
[method]
name = "multi_position"
"""


def outcome(folder: Path, seed: int, step: float, tremor_deg: float) -> Outcome:
    rng = np.random.default_rng([seed, 19])
    session = handheld.Session(hold_seconds=4.0, tremor_deg=tremor_deg, tremor_push=tremor_deg / 10)
    device = handheld.triangular(mems(rng, G=np.zeros((3, 3))))
    made = handheld.record(device, session, rng)
    start, stop = made.rests[7]
    made.data[0, (start + stop) // 2 : stop, 1] += step
    made.write_csv(folder / "log.csv")
    (folder / "run.toml").write_text(RUN, encoding="utf-8")
    return calibrate(folder / "run.toml")


@pytest.mark.parametrize("step", [1e-3 * G0, 4e-3 * G0])
def test_a_step_within_a_rest_is_named(tmp_path: Path, step: float):
    verdict = outcome(tmp_path, 1, step, 0.0).verdict
    assert verdict.grade != "consistent"
    assert any("change" in one and "within r08" in one for one in verdict.reasons)


@pytest.mark.parametrize("tremor_deg", [0.1, 0.5])
def test_the_sway_of_a_hand_is_no_change_of_the_accelerometers(tmp_path: Path, tremor_deg: float):
    verdict = outcome(tmp_path, 2, 0.0, tremor_deg).verdict
    assert not any("within" in one for one in verdict.reasons)

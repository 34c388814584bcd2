"""A step of an accelerometer within one hand-held rest, and a hand that trembles without one."""

from pathlib import Path

import numpy as np
import pytest
from tests.accuracy import handheld
from tests.accuracy.ferraris import G0, mems
from tests.base_seeds import evidence

from inercal import calibrate
from inercal.benches import Hand
from inercal.methods.multi_position.rest_candidates import rest_changes
from inercal.methods.multi_position.rest_observations import Rests, Scatter
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
    session = handheld.Session(hold_seconds=4.0, tremor_deg=tremor_deg, tremor_push=tremor_deg / 50)
    device = handheld.triangular(mems(rng, G=np.zeros((3, 3))))
    made = handheld.record(device, session, rng)
    start, stop = made.rests[7]
    across = int(np.argmin(np.abs(made.ups[0, 7])))
    made.data[0, (start + stop) // 2 : stop, across] += step
    made.write_csv(folder / "log.csv")
    (folder / "run.toml").write_text(RUN, encoding="utf-8")
    return calibrate(folder / "run.toml")


@pytest.mark.slow
@pytest.mark.parametrize(("step", "tremor_deg"), [(1e-3, 0.0), evidence(4e-3, 0.0), (1.5e-3, 0.1)])
def test_a_step_within_a_rest_is_named(tmp_path: Path, step: float, tremor_deg: float):
    verdict = outcome(tmp_path, 1, step * G0, tremor_deg).verdict
    assert verdict.grade != "consistent"
    assert any("change" in one and "within r08" in one for one in verdict.reasons)


@pytest.mark.slow
@pytest.mark.parametrize("tremor_deg", [evidence(0.1), 0.5])
def test_the_sway_of_a_hand_is_no_change_of_the_accelerometers(tmp_path: Path, tremor_deg: float):
    verdict = outcome(tmp_path, 2, 0.0, tremor_deg).verdict
    assert not any("within" in one for one in verdict.reasons)


@pytest.mark.slow
def test_sway_hides_no_step_that_noise_does_not_hide(tmp_path: Path):
    """A wobble of 0.2° moves readings across gravity by milli-g, which the gyros see."""
    found = outcome(tmp_path, 1, 0.0, 0.2)
    assert isinstance(found.bench, Hand)
    rests = Rests(found.observations, found.calibration.sensor, found.bench)
    x = rests.start()
    x[: len(found.calibration.values)] = found.calibration.values
    shares = Scatter(*(group.spread for group in found.estimate.groups)).shares
    made = rest_changes(rests, rests.rows(x), x, shares)
    assert made is not None
    sd = 1 / np.linalg.norm(made.by_reading, axis=1)
    halves = found.observations.halves
    assert halves is not None
    assert np.sqrt(np.mean(halves.change[:, :3] ** 2)) > 1e-3 * G0
    assert np.all(sd < 0.3e-3 * G0)
    assert np.mean(made.residual**2) == pytest.approx(1.0, abs=0.5)

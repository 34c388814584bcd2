"""What one calibration did not measure is not compared, also where its frame is turned."""

import numpy as np
import pytest
from tests.base_seeds import SEEDS
from tests.refusals import refused

from inercal.calibration import Calibration
from inercal.calibration.comparison import compare
from inercal.physics.sensors import imu, triad
from inercal.physics.sensors.coefficient_selection import select_coefficients

ALL = ("k0", "k1", "misalignment", "bias", "scale")
ACCELEROMETERS = ("k0", "k1", "ax.misalignment", "ay.misalignment", "az.misalignment")


def calibration(rng: np.random.Generator, truth: dict[str, float], *groups: str) -> Calibration:
    """Return a calibration in the frame of the mount that errs by what it states."""
    sensor = imu()
    sensor = sensor.with_coefficients(*select_coefficients(sensor.axes, groups))
    std = 1e-4 * sensor.unit_scale
    exact = np.array([truth[name] for name in sensor.coefficients])
    return Calibration(sensor, exact + std * rng.normal(size=std.size), np.diag(std**2))


@pytest.mark.parametrize("seed", SEEDS)
def test_gyros_that_were_not_measured_are_left_out_in_another_frame(seed: int):
    rng = np.random.default_rng(seed)
    sensor = imu().with_coefficients(*select_coefficients(imu().axes, ALL))
    truth = dict(
        zip(
            sensor.coefficients,
            5e-3 * rng.normal(size=len(sensor.coefficients)) * sensor.unit_scale,
            strict=True,
        )
    )
    complete = calibration(rng, truth, *ALL).in_frame("triangular")
    partial = calibration(rng, truth, *ACCELEROMETERS, "bias")
    for found in (compare(partial, complete), compare(complete, partial)):
        assert not [name for name in found.names if name.startswith("g") and "delta" in name]
        assert {"gx.bias", "ax.k0", "az.delta_p"} <= set(found.names)
        joint = found.joint_test
        assert joint is not None
        assert joint.p_value > 1e-4


def test_what_a_frame_of_the_accelerometers_fixes_is_measured_in_another():
    rng = np.random.default_rng(1)
    sensor = imu().with_coefficients(*select_coefficients(imu().axes, ALL))
    truth = dict.fromkeys(sensor.coefficients, 0.0)
    triangular = calibration(rng, truth, *ALL).in_frame("triangular")
    symmetric = calibration(rng, truth, *ALL).in_frame("symmetric")
    names = compare(triangular, symmetric).names
    assert "ax.delta_o" in names
    assert "gx.delta_o" in names


def test_calibrations_without_a_common_coefficient_are_refused():
    first, second = (
        Calibration(triad(name, "f", name).with_coefficients("bias"), np.zeros(3), np.eye(3))
        for name in ("a", "b")
    )
    with refused(names=("a", "b")):
        compare(first, second)
    assert len(compare(first, first).names) == 3

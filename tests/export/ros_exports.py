"""Exports for ROS 2 that several tests share."""

from collections.abc import Callable
from functools import cache
from types import ModuleType
from typing import Any

from tests.export.calibrations import LINEAR, make_calibration, make_magnetometer
from tests.export.ros_stand_in import World

from inercal.calibration import Calibration
from inercal.export import Export, export_calibration

NAME = "imu_correct"
DENSITIES = {"accelerometer_noise_density": 1e-3, "gyroscope_noise_density": 2e-4}
Loaded = Callable[..., tuple[ModuleType, World]]


def export(calibration: Calibration, **options: Any) -> Export:
    return export_calibration(calibration, "ros2-node", options=options, name="imu")


@cache
def linear() -> Export:
    return export(make_calibration(*LINEAR, u=2e-3), update_rate=400, **DENSITIES)


@cache
def nine_axes() -> Export:
    return export(make_magnetometer("bias_dT", "scale_dT", inertial=True))

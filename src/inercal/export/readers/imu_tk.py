"""imu_tk: 21 numbers, T row by row, K row by row, B; x = T K (raw − B)."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from inercal.basics.errors import InputError
from inercal.export.readers.reader_definition import (
    CalibrationReader,
    StatedCalibration,
    StatedTriad,
)
from inercal.export.target_definition import TargetOption

_COUNT = 21


def _read(text: str, options: Mapping[str, Any]) -> StatedCalibration:
    words = text.split()[:_COUNT]
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError:
        numbers = np.zeros(0)
    if numbers.size < _COUNT or not np.isfinite(numbers).all():
        raise InputError("no .calib file of imu_tk: it begins with 21 numbers")
    matrix, scale = numbers[:9].reshape(3, 3), numbers[9:18].reshape(3, 3)
    correction = matrix @ scale
    if abs(np.linalg.det(correction)) == 0:
        raise InputError("T K has no inverse; restore the file")
    triad = StatedTriad(
        matrix=np.asarray(np.linalg.inv(correction), dtype=float), bias=numbers[18:]
    )
    accelerometer = options["part"] == "accelerometer"
    # With a lower triangle of zero, imu_tk's own frame of the accelerometers' axes.
    own = accelerometer and not np.tril(matrix, -1).any()
    return StatedCalibration(
        triad if accelerometer else None,
        None if accelerometer else triad,
        own_frame=own,
        output=True,
        notes=("turned from imu_tk's frame, z along the z axis, to x along the x axis",) * own,
    )


READER = CalibrationReader(
    "imu_tk",
    "imu_tk .calib",
    _read,
    (
        TargetOption(
            "part", "which triad", "accelerometer", kind=str, choices=("accelerometer", "gyro")
        ),
    ),
)

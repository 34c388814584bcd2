"""Kalibr: imu.yaml of a result; y = M f + b, y_g = M_g C_gyro_i ω + A C_gyro_i f + b_g.

The file has no biases. In its frame x lies along the accelerometers' x, y in the plane of x, y.
"""

from collections.abc import Mapping
from importlib import import_module
from typing import Any, cast

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, require_extra
from inercal.export.readers.reader_definition import (
    CalibrationReader,
    StatedCalibration,
    StatedTriad,
)
from inercal.export.target_definition import TargetOption


def _read(text: str, options: Mapping[str, Any]) -> StatedCalibration:
    with require_extra("kalibr", "files of Kalibr need PyYAML", ("yaml",)):
        yaml: Any = import_module("yaml")
    try:
        content = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise InputError(f"no YAML that can be read: {error}") from None
    name = options["imu"]
    one = _section(content, name)
    if one is None:
        raise InputError(
            f"no IMU {name!r}: give a result of Kalibr, or --set imu=… with another name",
            names=(name,),
        )
    force, rate = _section(one, "accelerometers"), _section(one, "gyroscopes")
    if force is None or rate is None:
        raise InputError(
            f"{name} is of model {one.get('model')!r}, without intrinsics: calibrate with Kalibr's "
            "model scale-misalignment"
        )
    matrix, gyro = _matrix(force, "M"), _matrix(rate, "M")
    turn = _matrix(rate, "C_gyro_i")
    return StatedCalibration(
        StatedTriad(matrix=matrix),
        StatedTriad(matrix=gyro @ turn, sensitivity=_matrix(rate, "A") @ turn),
        frame="triangular",
        notes=("Kalibr states no biases",),
    )


def _section(content: Any, name: str) -> dict[str, Any] | None:
    """Return a map within a map; None where there is none."""
    found = cast("dict[str, Any]", content).get(name) if isinstance(content, dict) else None
    return cast("dict[str, Any]", found) if isinstance(found, dict) else None


def _matrix(content: Mapping[str, Any], name: str) -> Array:
    found = content.get(name)
    rows = cast("list[Any]", found) if isinstance(found, list) else []
    # Checked before numpy sees it: by aliases a small file can describe a huge array.
    numbers = [
        float(x)
        for row in rows[:4]
        if isinstance(row, list)
        for x in cast("list[Any]", row)[:4]
        if isinstance(x, int | float)
    ]
    if len(rows) != 3 or len(numbers) != 9 or not np.isfinite(numbers).all():
        raise InputError(f"{name} must be 3 × 3 finite numbers", names=(name,))
    return np.array(numbers).reshape(3, 3)


READER = CalibrationReader(
    "kalibr",
    "Kalibr imu.yaml",
    _read,
    (TargetOption("imu", "which IMU of the file", "imu0", kind=str),),
)

"""RealSense: `calibration.json` of the IMU calibration tool of librealsense.

    out = S in − bias

The bias is subtracted after multiplication by the matrix, so S = C = M⁻¹ and bias = C b, in m/s²
and rad/s. The tool multiplies a row of readings by the matrix, and the camera stores the matrix
column by column, so `scale_and_alignment` contains the rows of Sᵀ. The tool does not estimate the
matrix of the gyroscope and always writes the identity. Sources: rs-imu-calibration.py,
motion-transform.cpp and float3.h of IntelRealSense/librealsense (Apache-2.0), described in words.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from inercal.export.target_definition import (
    CalibrationReader,
    Rendering,
    Request,
    StatedCalibration,
    StatedTriad,
    Target,
    TargetOption,
)
from inercal.export.targets import shared
from inercal.physics.quantities import Measures

_KINDS: tuple[tuple[Measures, str], ...] = (("f", "accelerometer"), ("w", "gyroscope"))
_MATRIX = "scale_and_alignment"
_DIGITS = 12
_DEVICE = TargetOption("device_type", "type of the camera", "D435i", kind=str)


def _render(request: Request) -> Rendering:
    triads = dict(request.model.triads)
    imu: dict[str, dict[str, list[float]]] = {}
    corrections: dict[str, shared.Correction] = {}
    for kind, name in _KINDS:
        matrix, bias = np.eye(3), np.zeros(3)
        if kind in triads:
            matrix = shared.written(triads[kind].correction, _DIGITS)
            bias = shared.written(triads[kind].correction @ triads[kind].bias, _DIGITS)
            corrections[kind] = lambda y, dT, matrix=matrix, bias=bias: y @ matrix.T - bias
        imu[name] = {_MATRIX: matrix.T.ravel().tolist(), "bias": bias.tolist()}
    content = {"device_type": request.options["device_type"], "imus": [imu]}

    def write(header: Sequence[str]) -> str:
        return json.dumps({"comment": "\n".join(header), **content}, indent=4) + "\n"

    missing = [name for kind, name in _KINDS if kind not in triads]
    return Rendering(
        shared.by_triad(request.model, corrections),
        write,
        ("out = S in - bias; scale_and_alignment is S column by column",),
        "readings of the camera without motion correction, in m/s^2 and rad/s",
        (
            "the axes must be those of the depth camera: x right, y down, z forward",
            "no program loads this file into a camera: the flash of the camera contains the same "
            "24 numbers in its own table (calibration.bin), which inercal does not write",
            *(f"the {name} is not calibrated, so its matrix is 1 and its bias 0"
              for name in missing),
        ),
    )  # fmt: skip


def _read(text: str, options: Mapping[str, Any]) -> StatedCalibration:
    triads: dict[str, StatedTriad] = {}
    notes: list[str] = []
    for kind, name in _KINDS:
        one = shared.json_section(text, "a calibration.json of RealSense", "imus", 0, name)
        matrix = shared.json_numbers(one, _MATRIX, 9).reshape(3, 3).T
        triad = shared.offset_triad(matrix, shared.json_numbers(one, "bias", 3), _MATRIX)
        if kind == "w" and np.array_equal(matrix, np.eye(3)):
            triad = StatedTriad(bias=triad.bias)
            notes.append(
                "the RealSense tool estimates neither the scale nor the misalignments of gyros"
            )
        triads[kind] = triad
    return StatedCalibration(triads["f"], triads["w"], notes=tuple(notes))


TARGET = Target(
    "realsense",
    "RealSense calibration.json of the IMU",
    ".json",
    {"f": shared.MATRIX, "w": shared.MATRIX},
    _render,
    (_DEVICE,),
)
READER = CalibrationReader("realsense", "calibration.json of RealSense", _read)

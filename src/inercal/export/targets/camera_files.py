"""Calibration files (JSON) of IMUs on cameras: Basalt and RealSense.

Basalt: the keys of the IMU in a calibration file (JSON).

    a = (1 + S) y − b            accelerometers, S lower triangular, 9 numbers: b, then S
    ω = (1 + S_g) y_g − b_g      gyros, 12 numbers: b_g, then S_g

Both lists contain b first and then the columns of the matrix, for accelerometers without the
elements above the diagonal. In the IMU frame of Basalt, x lies along the accelerometer's x axis,
and y in the plane of its x and y axes. With M = L Q as in `inercal.export.targets.kalibr`, 1 + S =
L⁻¹, b = L⁻¹ b_y, 1 + S_g = Q G⁻¹ and b_g = Q G⁻¹ b_yg. The standard deviations of the noise are
densities in continuous time. Basalt multiplies those of white noise by the square root of
`imu_update_rate`. Sources: calib_bias.hpp, calibration.hpp and headers_serialization.h of
basalt-headers (BSD-3), described in words.

RealSense: `calibration.json` of the IMU calibration tool of librealsense.

    out = S in − bias

The bias is subtracted after multiplication by the matrix, so S = C = M⁻¹ and bias = C b, in m/s²
and rad/s. The tool multiplies a row of readings by the matrix, and the camera stores the matrix
column by column, so `scale_and_alignment` contains the rows of Sᵀ. The tool does not estimate the
matrix of the gyroscope and always writes the identity. Sources: rs-imu-calibration.py,
motion-transform.cpp and float3.h of IntelRealSense/librealsense (Apache-2.0), described in words.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from inercal.export.reader_definition import CalibrationReader, StatedCalibration, StatedTriad
from inercal.export.target_definition import Rendering, Request, Target, TargetOption
from inercal.export.targets import shared
from inercal.export.targets.kalibr import NOISE_OPTIONS, frame_remark, noise_values
from inercal.physics import frames
from inercal.physics.quantities import Measures

_DIGITS = 12
_TRIANGLE = [0, 1, 2, 4, 5, 8]  # places of a lower triangle among its elements, column by column
_NOISE = {
    "accel_noise_std": "accelerometer_noise_density",
    "gyro_noise_std": "gyroscope_noise_density",
    "accel_bias_std": "accelerometer_random_walk",
    "gyro_bias_std": "gyroscope_random_walk",
}


def _render_basalt(request: Request) -> Rendering:
    model = request.model
    acc, gyro = model.require("f", "basalt"), model.require("w", "basalt")
    shared.require_aligned(model, "basalt")
    lower, found = frames.decompose_triangular(acc.matrix)
    turn = shared.written(found, _DIGITS)
    scale = shared.written(shared.inverse(lower) - np.eye(3), _DIGITS)
    bias = shared.written(shared.inverse(lower) @ acc.bias, _DIGITS)
    scale_g = shared.written(turn @ gyro.correction - np.eye(3), _DIGITS)
    bias_g = shared.written(turn @ gyro.correction @ gyro.bias, _DIGITS)
    noise = noise_values(request.options, "basalt")
    content = {
        "calib_accel_bias": [*bias.tolist(), *scale.T.ravel()[_TRIANGLE].tolist()],
        "calib_gyro_bias": [*bias_g.tolist(), *scale_g.T.ravel().tolist()],
        "imu_update_rate": noise["update_rate"],
    } | {name: [noise[key]] * 3 for name, key in _NOISE.items()}

    return Rendering(
        shared.by_triad(
            model,
            {
                "f": lambda y, dT: (y + y @ scale.T - bias) @ turn,
                "w": lambda y, dT: (y + y @ scale_g.T - bias_g) @ turn,
            },
        ),
        shared.json_with_comment({"value0": content}),
        ("a = (1 + S) y - b, S lower triangular; w = (1 + S_g) y_g - b_g",),
        remarks=(
            frame_remark(turn),
            "copy these keys into value0 of the calibration file of Basalt, which also needs the "
            "cameras; T_imu_cam there must refer to the frame of this file",
        ),
    )


def _triad(section: Mapping[str, Any], name: str, places: Sequence[int]) -> StatedTriad:
    """Return a triad from b and the elements of S at some places, column by column."""
    numbers = shared.json_numbers(section, name, 3 + len(places))
    scale = np.zeros(9)
    scale[list(places)] = numbers[3:]
    return shared.offset_triad(np.eye(3) + scale.reshape(3, 3).T, numbers[:3], name)


def _read_basalt(text: str, options: Mapping[str, Any]) -> StatedCalibration:
    content = shared.json_section(text, "a calibration of Basalt", "value0")
    return StatedCalibration(
        {
            "f": _triad(content, "calib_accel_bias", _TRIANGLE),
            "w": _triad(content, "calib_gyro_bias", range(9)),
        },
        frame="triangular",
        notes=("the noise and the cameras of the file are not imported",),
    )


BASALT = Target(
    "basalt",
    "Basalt calibration file, keys of the IMU",
    ".json",
    shared.MATRICES,
    _render_basalt,
    NOISE_OPTIONS,
)
BASALT_READER = CalibrationReader("basalt", "calibration of Basalt", _read_basalt)


_KINDS: tuple[tuple[Measures, str], ...] = (("f", "accelerometer"), ("w", "gyroscope"))
_MATRIX = "scale_and_alignment"
_DEVICE = TargetOption("device_type", "type of the camera", "D435i", kind=str)


def _render_realsense(request: Request) -> Rendering:
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

    missing = [name for kind, name in _KINDS if kind not in triads]
    return Rendering(
        shared.by_triad(request.model, corrections),
        shared.json_with_comment(content),
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


def _read_realsense(text: str, options: Mapping[str, Any]) -> StatedCalibration:
    triads: dict[Measures, StatedTriad] = {}
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
    return StatedCalibration(triads, notes=tuple(notes))


REALSENSE = Target(
    "realsense",
    "RealSense calibration.json of the IMU",
    ".json",
    shared.MATRICES,
    _render_realsense,
    (_DEVICE,),
)
REALSENSE_READER = CalibrationReader("realsense", "calibration.json of RealSense", _read_realsense)

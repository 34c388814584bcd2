"""Three files with a matrix and a bias of each triad: imu_tk, imu_calib and imucal.

imu_tk: a .calib file of one triad.

    x = T K (raw − B)

K is diagonal, and the diagonal of T is 1. The correction of the sensor's own output is x = C
(output − o), so K = diag(C_ii), T = C K⁻¹ and B = o. The program reads 21 numbers and ignores the
rest of the file, which contains the explanation. Source: calibration.h of imu_tk (2-clause BSD),
described in words.

ROS imu_calib: a YAML file with SM and bias of the accelerometers.

    f = SM y − bias

The bias is subtracted after multiplication by the matrix, so SM = C = M⁻¹ and bias = C b. Source:
accel_calib.cpp of dpkoch/imu_calib (BSD-3), described in words.

imucal: JSON file of a Ferraris or turntable calibration.

    a = R_a⁻¹ K_a⁻¹ (raw − b_a),   ω = R_g⁻¹ K_g⁻¹ (raw − K_ga a − b_g)

With output = offset + scale (M f + b), K_a = diag(scale), R_a = M, b_a = offset + scale b, and K_ga
= scale A with the scale of the gyros. Source: ferraris_calibration_info.py of mad-lab-fau/imucal
2.6 (MIT). The reader converts results from acc_unit and gyr_unit to m/s² and rad/s.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import si_factor
from inercal.export.reader_definition import CalibrationReader, StatedCalibration, StatedTriad
from inercal.export.target_definition import Rendering, Request, Target, TargetOption
from inercal.export.targets import shared

_TK_COUNT = 21  # numbers: T and K row by row, then B
_TK_OPTIONS = (
    TargetOption(
        "part", "which triad", "accelerometer", kind=str, choices=("accelerometer", "gyro")
    ),
)


def _render_imu_tk(request: Request) -> Rendering:
    model = request.model
    kind = "f" if request.options["part"] == "accelerometer" else "w"
    triad = model.require(kind, "imu_tk")
    correction = triad.correction / triad.scale
    scale = np.diag(np.diag(correction))
    parts = [shared.written(m, 12) for m in (correction @ np.linalg.inv(scale), scale)]
    bias = shared.written(triad.offset + triad.scale * triad.bias, 12)

    def write(header: Sequence[str]) -> str:
        blocks = [
            "\n".join(" ".join(shared.number(x, 12) for x in row) for row in m) for m in parts
        ]
        blocks.append("\n".join(shared.number(x, 12) for x in bias))
        return "\n\n".join([*blocks, "\n".join(header)]) + "\n"

    def correct(y: Array, dT: Array) -> Array:
        return (triad.offset + triad.scale * y - bias) @ (parts[0] @ parts[1]).T

    other = "w" if kind == "f" else "f"
    remark = ("the other triad needs a second file: --set part=accelerometer or part=gyro",)
    return Rendering(
        shared.by_triad(model, {kind: correct}),
        write,
        ("x = T K (raw - B): T, then K, then B above",),
        shared.output_text(triad),
        remark * any(k == other for k, _ in model.triads),
        takes_output=True,
        holds={kind: shared.MATRIX},
    )


def _read_imu_tk(text: str, options: Mapping[str, Any]) -> StatedCalibration:
    words = text.split()[:_TK_COUNT]
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError:
        numbers = np.zeros(0)
    if numbers.size < _TK_COUNT or not np.isfinite(numbers).all():
        raise InputError("this is not a .calib file of imu_tk, which begins with 21 numbers")
    matrix, scale = numbers[:9].reshape(3, 3), numbers[9:18].reshape(3, 3)
    correction = matrix @ scale
    if abs(np.linalg.det(correction)) == 0:
        raise InputError("T K has no inverse; restore the file")
    triad = StatedTriad(matrix=shared.inverse(correction), bias=numbers[18:])
    accelerometer = options["part"] == "accelerometer"
    # If the lower triangle is zero, this is imu_tk's own frame, defined by the accelerometers'
    # axes.
    own = accelerometer and not np.tril(matrix, -1).any()
    return StatedCalibration(
        {"f" if accelerometer else "w": triad},
        own_frame=own,
        output=True,
        notes=("turned from imu_tk's frame, z along the z axis, to x along the x axis",) * own,
    )


IMU_TK = Target("imu_tk", "imu_tk .calib of one triad", ".calib",
                shared.MATRICES, _render_imu_tk, _TK_OPTIONS)  # fmt: skip
IMU_TK_READER = CalibrationReader("imu_tk", "imu_tk .calib", _read_imu_tk, _TK_OPTIONS)


def _render_imu_calib(request: Request) -> Rendering:
    model = request.model
    triad = model.require("f", "imu_calib")
    matrix = shared.written(triad.correction, 12)
    bias = shared.written(triad.correction @ triad.bias, 12)

    rows = ",\n     ".join(shared.yaml_row(row, 12) for row in matrix)
    gyros = ("gyros are not corrected: imu_calib uses a mean at rest",) * (
        model.triad("w") is not None
    )
    return Rendering(
        shared.by_triad(model, {"f": lambda y, dT: y @ matrix.T - bias}),
        shared.with_comments(f"SM: [{rows}]\nbias: [{shared.yaml_row(bias, 12)}]\n"),
        ("f = SM y - bias (the bias is subtracted after the matrix)",),
        "readings of sensor_msgs/Imu in m/s^2",
        gyros,
    )


IMU_CALIB = Target(
    "imu_calib",
    "ROS imu_calib, YAML of the accelerometers",
    ".yaml",
    {"f": shared.MATRIX},
    _render_imu_calib,
)


_UNITS = {"deg/s": "°/s", "dps": "°/s"}
_MATRICES = ("K_a", "R_a", "b_a", "K_g", "R_g", "K_ga", "b_g")
_IMUCAL_OPTIONS = (
    *(
        TargetOption(name, "unit of the readings, as the user of imucal passes it", kind=str)
        for name in ("from_acc_unit", "from_gyr_unit")
    ),
    TargetOption(
        "cal_type", "class of imucal", "Ferraris", kind=str, choices=("Ferraris", "Turntable")
    ),
)


def _render_imucal(request: Request) -> Rendering:
    model, options = request.model, request.options
    acc, gyro = model.require("f", "imucal"), model.require("w", "imucal")
    content = {
        "cal_type": options["cal_type"],
        "_format_version": "2.0.0",
        "acc_unit": "m/s^2",
        "gyr_unit": "rad/s",
        "from_acc_unit": options["from_acc_unit"] or acc.unit,
        "from_gyr_unit": options["from_gyr_unit"] or gyro.unit,
        "K_a": np.diag(acc.scale).tolist(),
        "R_a": acc.matrix.tolist(),
        "b_a": (acc.offset + acc.scale * acc.bias).tolist(),
        "K_g": np.diag(gyro.scale).tolist(),
        "R_g": gyro.matrix.tolist(),
        "K_ga": (gyro.scale[:, None] * model.g_sensitivity).tolist(),
        "b_g": (gyro.offset + gyro.scale * gyro.bias).tolist(),
    }

    def correct(readings: Array, dT: Array) -> Array:
        # The numbers in the file are exact, because JSON can represent doubles.
        return (readings - model.joined("bias")) @ model.correction.T

    def write(header: Sequence[str]) -> str:
        return json.dumps(content | {"comment": "\n".join(header)}, indent=1) + "\n"

    return Rendering(
        correct,
        write,
        ("f = R_a^-1 K_a^-1 (raw - b_a); w = R_g^-1 K_g^-1 (raw - K_ga f - b_g)",),
        shared.output_text(acc, gyro),
        ("the units passed to imucal must be spelt as from_acc_unit and from_gyr_unit here",),
        takes_output=True,
    )


def _read_imucal(text: str, options: Mapping[str, Any]) -> StatedCalibration:
    try:
        content = json.loads(text)
        arrays = {name: np.array(content[name], dtype=float) for name in _MATRICES}
        units = [str(content[name]) for name in ("acc_unit", "gyr_unit")]
        raw = [str(content.get(name)) for name in ("from_acc_unit", "from_gyr_unit")]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(
            f"this is not a calibration of imucal: {type(error).__name__} {error}"
        ) from None
    for name, array in arrays.items():
        wanted = (3,) if name.startswith("b") else (3, 3)
        if array.shape != wanted or not np.isfinite(array).all():
            raise InputError(f"{name} must be {' × '.join(map(str, wanted))} finite numbers")
    force, rate = (
        si_factor(_UNITS.get(unit, unit), like=like)
        for unit, like in zip(units, ("m/s^2", "rad/s"), strict=True)
    )
    acc = StatedTriad(matrix=arrays["K_a"] @ arrays["R_a"] / force, bias=arrays["b_a"])
    gyro = StatedTriad(
        matrix=arrays["K_g"] @ arrays["R_g"] / rate,
        bias=arrays["b_g"],
        sensitivity=arrays["K_ga"] / force,
    )
    return StatedCalibration(
        {"f": acc, "w": gyro},
        output=True,
        units=(_UNITS.get(raw[0], raw[0]), _UNITS.get(raw[1], raw[1])),
        notes=(f"readings in {raw[0]} and {raw[1]}",),
    )


IMUCAL = Target("imucal", "imucal JSON", ".json", {"f": shared.MATRIX, "w": shared.MATRIX_AND_G},
                _render_imucal, _IMUCAL_OPTIONS)  # fmt: skip
IMUCAL_READER = CalibrationReader("imucal", "imucal JSON", _read_imucal)

"""imu_tk: a .calib file of one triad.

    x = T K (raw − B)

K is diagonal, and the diagonal of T is 1. The correction of the sensor's own output is x = C
(output − o), so K = diag(C_ii), T = C K⁻¹ and B = o. The program reads 21 numbers and ignores the
rest of the file, which contains the explanation. Source: calibration.h of imu_tk (2-clause BSD),
described in words.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.export.reader_definition import CalibrationReader, StatedCalibration, StatedTriad
from inercal.export.target_definition import Rendering, Request, Target, TargetOption
from inercal.export.targets.shared import MATRIX, by_triad, number, output_text, written

_COUNT = 21  # numbers: T and K row by row, then B
OPTIONS = (
    TargetOption(
        "part", "which triad", "accelerometer", kind=str, choices=("accelerometer", "gyro")
    ),
)


def _render(request: Request) -> Rendering:
    model = request.model
    kind = "f" if request.options["part"] == "accelerometer" else "w"
    triad = model.require(kind, "imu_tk")
    correction = triad.correction / triad.scale
    scale = np.diag(np.diag(correction))
    parts = [written(m, 12) for m in (correction @ np.linalg.inv(scale), scale)]
    bias = written(triad.offset + triad.scale * triad.bias, 12)

    def write(header: Sequence[str]) -> str:
        blocks = ["\n".join(" ".join(number(x, 12) for x in row) for row in m) for m in parts]
        blocks.append("\n".join(number(x, 12) for x in bias))
        return "\n\n".join([*blocks, "\n".join(header)]) + "\n"

    def correct(y: Array, dT: Array) -> Array:
        return (triad.offset + triad.scale * y - bias) @ (parts[0] @ parts[1]).T

    other = "w" if kind == "f" else "f"
    remark = ("the other triad needs a second file: --set part=accelerometer or part=gyro",)
    return Rendering(
        by_triad(model, {kind: correct}),
        write,
        ("x = T K (raw - B): T, then K, then B above",),
        output_text(triad),
        remark * any(k == other for k, _ in model.triads),
        takes_output=True,
        holds={kind: MATRIX},
    )


def _read(text: str, options: Mapping[str, Any]) -> StatedCalibration:
    words = text.split()[:_COUNT]
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError:
        numbers = np.zeros(0)
    if numbers.size < _COUNT or not np.isfinite(numbers).all():
        raise InputError("this is not a .calib file of imu_tk, which begins with 21 numbers")
    matrix, scale = numbers[:9].reshape(3, 3), numbers[9:18].reshape(3, 3)
    correction = matrix @ scale
    if abs(np.linalg.det(correction)) == 0:
        raise InputError("T K has no inverse; restore the file")
    triad = StatedTriad(
        matrix=np.asarray(np.linalg.inv(correction), dtype=float), bias=numbers[18:]
    )
    accelerometer = options["part"] == "accelerometer"
    # If the lower triangle is zero, this is imu_tk's own frame, defined by the accelerometers'
    # axes.
    own = accelerometer and not np.tril(matrix, -1).any()
    return StatedCalibration(
        triad if accelerometer else None,
        None if accelerometer else triad,
        own_frame=own,
        output=True,
        notes=("turned from imu_tk's frame, z along the z axis, to x along the x axis",) * own,
    )


TARGET = Target("imu_tk", "imu_tk .calib of one triad", ".calib", {"f": MATRIX, "w": MATRIX},
                _render, OPTIONS)  # fmt: skip
READER = CalibrationReader("imu_tk", "imu_tk .calib", _read, OPTIONS)

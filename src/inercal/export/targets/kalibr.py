"""Kalibr: imu.yaml of its scale-misalignment model.

    y = M f + b,   y_g = M_g C_gyro_i ω + A C_gyro_i f + b_g

M and M_g are lower triangular, in the frame of `triangular`, so M = L, M_g = L_g, C_gyro_i = C_g
and A = A_body Qᵀ C_gᵀ: A acts on the force turned into the gyro's frame. Source: IccSensors.py of
ethz-asl/kalibr (BSD), described in words.
"""

from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.export.target_definition import Rendering, Request, Target
from inercal.export.targets.noise import NOISE_OPTIONS, noise_lines
from inercal.export.targets.shared import comments, written
from inercal.export.targets.triangular import (
    TriangularModel,
    triangular_model,
    turn_remark,
    yaml_matrix,
)
from inercal.export.term_kinds import TermKind

HOLDS: dict[str, frozenset[TermKind]] = {
    "f": frozenset({"scale", "misalignment"}),
    "w": frozenset({"scale", "misalignment", "g"}),
}


def _render(request: Request) -> Rendering:
    model = request.model
    one = triangular_model(model, "kalibr")
    noise = noise_lines(request.options, "kalibr")
    sensitivity = written(one.sensitivity @ one.gyro_turn.T, 12)

    def write(header: Sequence[str]) -> str:
        lines = ["imu0:", *(f"  {line}" for line in noise), "  model: scale-misalignment"]
        lines += yaml_matrix("T_i_b", np.eye(4), "  ", 1)
        lines += ["  accelerometers:", *yaml_matrix("M", one.accelerometer, "    ")]
        lines += ["  gyroscopes:", *yaml_matrix("M", one.gyro, "    ")]
        lines += yaml_matrix("A", sensitivity, "    ")
        lines += yaml_matrix("C_gyro_i", one.gyro_turn, "    ")
        return comments(header, "#") + "\n".join(lines) + "\n"

    acc, gyro = (triad for _, triad in model.triads)
    return Rendering(
        correction(one, np.zeros(3), np.zeros(3)),
        write,
        (
            "y = M f + b; y_g = M_g C_gyro_i w + A C_gyro_i f + b_g (predicted readings)",
            "corrected: f = M^-1 (y - b); w = C_gyro_i^T M_g^-1 (y_g - b_g - A C_gyro_i f)",
        ),
        remarks=(
            turn_remark(one),
            "Kalibr itself starts from M = I: this file is for programs that read its result",
        ),
        correct_with_bias=correction(one, written(acc.bias), written(gyro.bias)),
    )


def correction(one: TriangularModel, bias: Array, gyro_bias: Array):
    """Return the correction in the frame of the calibration, by the matrices of the file."""
    back = np.linalg.inv(one.accelerometer)
    back_g = one.gyro_turn.T @ np.linalg.inv(one.gyro)

    def correct(readings: Array, dT: Array) -> Array:
        f = (readings[:, :3] - bias) @ back.T
        w = (readings[:, 3:] - gyro_bias - f @ one.sensitivity.T) @ back_g.T
        return np.concatenate([f @ one.turn, w @ one.turn], axis=-1)

    return correct


TARGET = Target(
    "kalibr",
    "Kalibr imu.yaml, model scale-misalignment",
    ".yaml",
    HOLDS,
    _render,
    NOISE_OPTIONS,
)

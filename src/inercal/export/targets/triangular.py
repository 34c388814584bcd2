"""The IMU frame of Kalibr: x along the accelerometer's x axis, y in the plane of its x and y.

With M = L Q (L lower triangular, Q a rotation) the frame is t = Q body; there y = L f + b. The gyro
has a frame of its own, G Qᵀ = L_g C_g, and y_g = L_g C_g ω + A Qᵀ f + b_g.
"""

from dataclasses import dataclass

from inercal.basics.arrays import Array
from inercal.export.model import ExportModel
from inercal.export.targets.shared import require_aligned, row_text, written, yaml_row
from inercal.physics import frames


@dataclass(frozen=True, eq=False)
class TriangularModel:
    """L, Q, L_g, C_g and A Qᵀ as written, all (3, 3)."""

    accelerometer: Array
    turn: Array
    gyro: Array
    gyro_turn: Array
    sensitivity: Array


def triangular_model(model: ExportModel, target: str) -> TriangularModel:
    """Return the matrices of a calibration of accelerometers and gyros in the frame t.

    Raises
    ------
    InputError
        The sensor lacks one of the two kinds.
    """
    acc, gyro = model.require("f", target), model.require("w", target)
    require_aligned(model, target)
    lower, turn = frames.decompose_triangular(acc.matrix)
    lower_g, turn_g = frames.decompose_triangular(gyro.matrix @ turn.T)
    sensitivity = model.g_sensitivity @ turn.T
    return TriangularModel(*(written(m, 12) for m in (lower, turn, lower_g, turn_g, sensitivity)))


def turn_remark(one: TriangularModel) -> str:
    """Return how the frame of the file lies in that of the calibration."""
    rows = "; ".join(row_text(row, 12) for row in one.turn)
    return (
        f"frame of this file: f_file = Q f_calibration, w_file = Q w_calibration, with Q = [{rows}]"
    )


def yaml_matrix(name: str, matrix: Array, indent: str, digits: int = 12) -> list[str]:
    """Return a matrix as YAML, a flow list a row."""
    rows = [f"{indent}- [{yaml_row(row, digits)}]" for row in matrix]
    return [f"{indent}{name}:", *rows]

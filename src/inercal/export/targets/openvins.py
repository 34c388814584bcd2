"""OpenVINS: kalibr_imu_chain.yaml, model kalibr.

    f = R_ACCtoIMU Ta⁻¹ (y − b),   ω = R_GYROtoIMU Tw⁻¹ (y_g − b_g − Tg f)

with Ta = L, R_IMUtoACC = I, Tw = L_g, R_IMUtoGYRO = C_g and Tg = A Qᵀ, which acts on the force in
the IMU frame, not in the gyro's as Kalibr's A. Written from a description of ov_msckf and ov_core
(GPL-3); no line is taken from them.
"""

from collections.abc import Sequence

import numpy as np

from inercal.export.target_definition import Rendering, Request, Target
from inercal.export.targets.kalibr import HOLDS, correction
from inercal.export.targets.noise import NOISE_OPTIONS, noise_lines
from inercal.export.targets.shared import comments, written
from inercal.export.targets.triangular import triangular_model, turn_remark, yaml_matrix


def _render(request: Request) -> Rendering:
    model = request.model
    one = triangular_model(model, "openvins")
    noise = noise_lines(request.options, "openvins")

    def write(header: Sequence[str]) -> str:
        lines = ["imu0:", *(f"  {line}" for line in noise), '  model: "kalibr"']
        lines += yaml_matrix("T_i_b", np.eye(4), "  ", 1)
        lines += yaml_matrix("Tw", one.gyro, "  ")
        lines += yaml_matrix("R_IMUtoGYRO", one.gyro_turn, "  ")
        lines += yaml_matrix("Ta", one.accelerometer, "  ")
        lines += yaml_matrix("R_IMUtoACC", np.eye(3), "  ", 1)
        lines += yaml_matrix("Tg", one.sensitivity, "  ")
        return "%YAML:1.0\n" + comments(header, "#") + "\n" + "\n".join(lines) + "\n"

    acc, gyro = (triad for _, triad in model.triads)
    return Rendering(
        correction(one, np.zeros(3), np.zeros(3)),
        write,
        ("f = Ta^-1 (y - b); w = R_IMUtoGYRO^T Tw^-1 (y_g - b_g - Tg f)",),
        remarks=(
            turn_remark(one),
            "to keep these numbers set calib_imu_intrinsics and calib_imu_g_sensitivity to false "
            "in estimator_config.yaml; biases are estimated while it runs",
        ),
        correct_with_bias=correction(one, written(acc.bias), written(gyro.bias)),
    )


TARGET = Target(
    "openvins",
    "OpenVINS kalibr_imu_chain.yaml, model kalibr",
    ".yaml",
    HOLDS,
    _render,
    NOISE_OPTIONS,
)

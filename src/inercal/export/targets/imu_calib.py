"""ROS imu_calib: a YAML file with SM and bias of the accelerometers.

    f = SM y − bias

The bias is subtracted after multiplication by the matrix, so SM = C = M⁻¹ and bias = C b. Source:
accel_calib.cpp of dpkoch/imu_calib (BSD-3), described in words.
"""

from inercal.export.target_definition import Rendering, Request, Target
from inercal.export.targets.shared import MATRIX, by_triad, with_comments, written, yaml_row


def _render(request: Request) -> Rendering:
    model = request.model
    triad = model.require("f", "imu_calib")
    matrix = written(triad.correction, 12)
    bias = written(triad.correction @ triad.bias, 12)

    rows = ",\n     ".join(yaml_row(row, 12) for row in matrix)
    gyros = ("gyros are not corrected: imu_calib uses a mean at rest",) * (model.gyro is not None)
    return Rendering(
        by_triad(model, {"f": lambda y, dT: y @ matrix.T - bias}),
        with_comments(f"SM: [{rows}]\nbias: [{yaml_row(bias, 12)}]\n"),
        ("f = SM y - bias (the bias is subtracted after the matrix)",),
        "readings of sensor_msgs/Imu in m/s^2",
        gyros,
    )


TARGET = Target(
    "imu_calib", "ROS imu_calib, YAML of the accelerometers", ".yaml", {"f": MATRIX}, _render
)

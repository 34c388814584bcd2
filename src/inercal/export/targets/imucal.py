"""imucal: its JSON file of a Ferraris or turntable calibration.

    a = R_a⁻¹ K_a⁻¹ (raw − b_a),   ω = R_g⁻¹ K_g⁻¹ (raw − K_ga a − b_g)

With output = offset + scale (M f + b): K_a = diag(scale), R_a = M, b_a = offset + scale b, and
K_ga = scale A of the gyros. Source: ferraris_calibration_info.py of mad-lab-fau/imucal 2.6 (MIT).
"""

import json
from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.export.target_definition import Rendering, Request, Target, TargetOption
from inercal.export.targets.shared import MATRIX, MATRIX_AND_G, output_text

OPTIONS = (
    TargetOption(
        "from_acc_unit", "unit of the readings, as the user of imucal passes it", kind=str
    ),
    TargetOption(
        "from_gyr_unit", "unit of the readings, as the user of imucal passes it", kind=str
    ),
    TargetOption(
        "cal_type",
        "class of imucal",
        "Ferraris",
        kind=str,
        choices=("Ferraris", "Turntable"),
    ),
)


def _render(request: Request) -> Rendering:
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
        # The numbers of the file are exact: JSON holds doubles.
        return (readings - model.joined("bias")) @ model.correction.T

    def write(header: Sequence[str]) -> str:
        return json.dumps(content | {"comment": "\n".join(header)}, indent=1) + "\n"

    return Rendering(
        correct,
        write,
        ("f = R_a^-1 K_a^-1 (raw - b_a); w = R_g^-1 K_g^-1 (raw - K_ga f - b_g)",),
        output_text(acc, gyro),
        ("the units passed to imucal must be spelt as from_acc_unit and from_gyr_unit here",),
        takes_output=True,
    )


TARGET = Target("imucal", "imucal JSON", ".json", {"f": MATRIX, "w": MATRIX_AND_G},
                _render, OPTIONS)  # fmt: skip

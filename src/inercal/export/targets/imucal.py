"""imucal: JSON file of a Ferraris or turntable calibration.

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
from inercal.export.targets.shared import MATRIX, MATRIX_AND_G, output_text

_UNITS = {"deg/s": "°/s", "dps": "°/s"}
_MATRICES = ("K_a", "R_a", "b_a", "K_g", "R_g", "K_ga", "b_g")
OPTIONS = (
    *(
        TargetOption(name, "unit of the readings, as the user of imucal passes it", kind=str)
        for name in ("from_acc_unit", "from_gyr_unit")
    ),
    TargetOption(
        "cal_type", "class of imucal", "Ferraris", kind=str, choices=("Ferraris", "Turntable")
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
        # The numbers in the file are exact, because JSON can represent doubles.
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


def _read(text: str, options: Mapping[str, Any]) -> StatedCalibration:
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
        acc,
        gyro,
        output=True,
        units=(_UNITS.get(raw[0], raw[0]), _UNITS.get(raw[1], raw[1])),
        notes=(f"readings in {raw[0]} and {raw[1]}",),
    )


TARGET = Target("imucal", "imucal JSON", ".json", {"f": MATRIX, "w": MATRIX_AND_G},
                _render, OPTIONS)  # fmt: skip
READER = CalibrationReader("imucal", "imucal JSON", _read)

"""imucal: JSON; a = R_a⁻¹ K_a⁻¹ (raw − b_a), ω = R_g⁻¹ K_g⁻¹ (raw − K_ga a − b_g).

So raw = K_a R_a a + b_a, and raw = K_g R_g ω + K_ga a + b_g, in the units from_acc_unit and
from_gyr_unit. Results are in acc_unit and gyr_unit, which are taken to m/s² and rad/s.
"""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from inercal.basics.errors import InputError
from inercal.basics.units import si_factor
from inercal.export.readers.reader_definition import (
    CalibrationReader,
    StatedCalibration,
    StatedTriad,
)

_UNITS = {"deg/s": "°/s", "dps": "°/s"}
_MATRICES = ("K_a", "R_a", "b_a", "K_g", "R_g", "K_ga", "b_g")


def _read(text: str, options: Mapping[str, Any]) -> StatedCalibration:
    try:
        content = json.loads(text)
        arrays = {name: np.array(content[name], dtype=float) for name in _MATRICES}
        units = [str(content[name]) for name in ("acc_unit", "gyr_unit")]
        raw = [str(content.get(name)) for name in ("from_acc_unit", "from_gyr_unit")]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(f"no calibration of imucal: {type(error).__name__} {error}") from None
    for name, array in arrays.items():
        wanted = (3,) if name.startswith("b") else (3, 3)
        if array.shape != wanted or not np.isfinite(array).all():
            raise InputError(f"{name} must be {' × '.join(map(str, wanted))} finite numbers")
    force, rate = (
        si_factor(_UNITS.get(unit, unit), like=like)
        for unit, like in zip(units, ("m/s^2", "rad/s"), strict=True)
    )
    one = arrays
    acc = StatedTriad(matrix=one["K_a"] @ one["R_a"] / force, bias=one["b_a"])
    gyro = StatedTriad(
        matrix=one["K_g"] @ one["R_g"] / rate, bias=one["b_g"], sensitivity=one["K_ga"] / force
    )
    return StatedCalibration(
        acc,
        gyro,
        output=True,
        units=(_UNITS.get(raw[0], raw[0]), _UNITS.get(raw[1], raw[1])),
        notes=(f"readings in {raw[0]} and {raw[1]}",),
    )


READER = CalibrationReader("imucal", "imucal JSON", _read)

"""PX4: parameters as QGroundControl saves them: vehicle, component, name, value, type.

raw = f/SCALE + OFF + X0 + X1 Δ + X2 Δ² + X3 Δ³,   Δ = T − TREF
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS
from inercal.export.readers.reader_definition import (
    CalibrationReader,
    StatedCalibration,
    StatedTriad,
    parameter_calibration,
)
from inercal.export.target_definition import TargetOption

_FIELDS = 5
_SETS = 4
_ORDERS = 3


def _read(text: str, options: Mapping[str, Any]) -> StatedCalibration:
    known = _parameters(text)
    n = options["instance"]
    triads: dict[str, StatedTriad] = {}
    references: set[float] = set()
    for kind, word, letter in (("f", "ACC", "A"), ("w", "GYRO", "G")):
        stem = f"CAL_{word}{n}_"
        if f"{stem}XOFF" not in known:
            continue
        bias = np.array([known.get(f"{stem}{a}OFF", 0.0) for a in "XYZ"])
        scale = np.array([known.get(f"{stem}{a}SCALE", 1.0) for a in "XYZ"])
        if (scale == 0).any():
            raise InputError(f"{stem}XSCALE … ZSCALE have a 0; they must be near 1")
        powers = np.zeros((0, 3))
        if (thermal := _thermal_set(known, letter, known.get(f"{stem}ID"))) is not None:
            table = np.array(
                [
                    [known.get(f"{thermal}X{k}_{a}", 0.0) for a in range(3)]
                    for k in range(_ORDERS + 1)
                ]
            )
            bias, powers = bias + table[0], table[1:]
            references.add(known.get(f"{thermal}TREF", 25.0) + ZERO_CELSIUS)
        triads[kind] = StatedTriad(
            scale=1 / scale if kind == "f" else None, bias=bias, bias_powers=powers
        )
    if not triads:
        raise InputError(
            f"no parameters CAL_ACC{n}_XOFF or CAL_GYRO{n}_XOFF: give parameters of PX4, or "
            "another --set instance=…"
        )
    return parameter_calibration("PX4", triads, references, "TREF")


def _thermal_set(known: Mapping[str, float], letter: str, device: float | None) -> str | None:
    """Return the stem of the thermal parameters of a device that are in force."""
    if device is None or known.get(f"TC_{letter}_ENABLE") != 1:
        return None
    stems: Sequence[str] = [f"TC_{letter}{m}_" for m in range(_SETS)]
    return next((stem for stem in stems if known.get(f"{stem}ID") == device), None)


def _parameters(text: str) -> dict[str, float]:
    known: dict[str, float] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            if len(words) != _FIELDS:
                raise ValueError
            known[words[2]] = float(words[3])
        except ValueError:
            raise InputError(
                f"line {number} has not the five fields of QGroundControl's parameters: vehicle, "
                "component, name, value, type",
                line=number,
            ) from None
    return known


READER = CalibrationReader(
    "px4",
    "PX4 parameter",
    _read,
    (TargetOption("instance", "n of CAL_ACCn and CAL_GYROn", 0, kind=int),),
)

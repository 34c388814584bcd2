"""ArduPilot: parameters, `NAME,VALUE` or `NAME VALUE`.

    raw = f/SCAL + OFFS + P(T − 35) − P(T_cal − 35),   P(t) = (c₁ t + c₂ t² + c₃ t³) 10⁻⁶

The reference temperature becomes T_cal within TMIN … TMAX, where the bias is OFFS.
"""

from collections.abc import Mapping
from math import inf
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
from inercal.export.targets.ardupilot import CENTRE, ORDERS, UNIT, parameter_names, shifted


def _read(text: str, options: Mapping[str, Any]) -> StatedCalibration:
    known = _parameters(text)
    imu = options["imu"]
    thermal = known.get(f"INS_TCAL{imu}_ENABLE") == 1
    triads: dict[str, StatedTriad] = {}
    references: set[float] = set()
    for kind, word in (("f", "ACC"), ("w", "GYR")):
        offsets, scales, _, temperature = parameter_names(kind, imu)
        if f"{offsets}X" not in known:
            continue
        bias = np.array([known.get(offsets + a, 0.0) for a in "XYZ"])
        scale = np.array([known.get(scales + a, 1.0) for a in "XYZ"])
        if (scale == 0).any():
            raise InputError(f"{scales}X … Z have a 0: this accelerometer was not calibrated")
        powers = np.zeros((0, 3))
        if thermal:
            if temperature not in known:
                raise InputError(f"{temperature} is missing: the offsets have no temperature")
            lowest = known.get(f"INS_TCAL{imu}_TMIN", -inf)
            highest = known.get(f"INS_TCAL{imu}_TMAX", inf)
            taken = min(max(known[temperature], lowest), highest)
            about = [
                [known.get(f"INS_TCAL{imu}_{word}{k}_{a}", 0.0) for a in "XYZ"]
                for k in range(1, ORDERS + 1)
            ]
            powers = shifted(np.array(about) * UNIT, taken - CENTRE)
            references.add(taken + ZERO_CELSIUS)
        triads[kind] = StatedTriad(
            scale=1 / scale if kind == "f" else None, bias=bias, bias_powers=powers
        )
    if not triads:
        raise InputError(
            f"no parameters of IMU {imu}, such as INS_ACCOFFS_X: give parameters of ArduPilot, or "
            "another --set imu=…"
        )
    return parameter_calibration("ArduPilot", triads, references, "CALTEMP")


def _parameters(text: str) -> dict[str, float]:
    known: dict[str, float] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            known[words[0]] = float(words[1])
        except (IndexError, ValueError):
            raise InputError(
                f"line {number} is no NAME,VALUE: give parameters of ArduPilot", line=number
            ) from None
    return known


READER = CalibrationReader(
    "ardupilot",
    "ArduPilot parameter",
    _read,
    (TargetOption("imu", "number of the IMU, 1 to 3", 1, kind=int),),
)

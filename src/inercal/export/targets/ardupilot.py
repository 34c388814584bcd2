"""ArduPilot: INS and COMPASS parameters, and INS_TCAL parameters if a bias depends on temperature.

    accelerometer   f = SCAL ∘ (raw − [P(T − 35) − P(T_cal − 35)] − OFFS)
    gyro            ω = raw − [P(T − 35) − P(T_cal − 35)] − OFFS
    P(t) = (c₁ t + c₂ t² + c₃ t³) 10⁻⁶, T and T_cal within TMIN … TMAX, °C
    magnetometer    m = S (SCALE (raw + OFS)), milligauss

OFS is the bias with the opposite sign, and S is symmetric: DIA is its diagonal, and ODI_X, ODI_Y
and ODI_Z are its elements 12, 13 and 23. It is P⁻¹ in D = P Q; ArduPilot has no place for the
rotation Q. OFFS is the bias at T_cal, and SCAL = 1/M_ii. The polynomial about 35 °C follows from
the polynomial about the reference T_r, Σ a_k (T − T_r)^k, with c_j = 10⁶ Σ_k (k over j) a_k (35 −
T_r)^(k−j). This module was written from a description of the order of operations in
AP_InertialSensor (GPL-3); no code was copied. The reader accepts every format of `parameter_files`.
The reference temperature becomes T_cal, limited to TMIN … TMAX.
"""

from collections.abc import Mapping
from math import comb, inf
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS
from inercal.export.parameter_files import parameter_calibration, stated_parameters
from inercal.export.ranges import temperature_limits
from inercal.export.reader_definition import CalibrationReader, StatedCalibration, StatedTriad
from inercal.export.target_definition import DEVICE_ID, Rendering, Request, Target, TargetOption
from inercal.export.targets import shared
from inercal.physics.quantities import Measures

_WORDS: dict[Measures, str] = {"f": "ACC", "w": "GYR"}
_MILLIGAUSS = 1e-7  # T
# Limits that ArduPilot's own calibration applies (CompassCalibrator.cpp).
_DIAGONALS, _OFF_DIAGONALS, _LARGEST_OFFSET = (0.2, 5.0), (-1.0, 1.0), 1800.0
_CENTRE = 35.0  # °C
_UNIT = 1e-6
_ORDERS = 3
_MIN_SPAN = 10.0  # K
_SMALLEST = 1e-9  # an offset of exactly 0 means "not calibrated"
_IMU = TargetOption("imu", "number of the IMU", 1, kind=int, limits=(1, 3))
_COMPASS = TargetOption("compass", "number of the compass", 1, kind=int, limits=(1, 3))
OPTIONS = (
    _IMU,
    _COMPASS,
    TargetOption("acc_id", "INS_ACC_ID of this board", kind=int, limits=DEVICE_ID),
    TargetOption("gyro_id", "INS_GYR_ID of this board", kind=int, limits=DEVICE_ID),
    TargetOption("mag_id", "COMPASS_DEV_ID of this board", kind=int, limits=DEVICE_ID),
    TargetOption("offset_max", "COMPASS_OFFS_MAX of this board, milligauss", _LARGEST_OFFSET),
    shared.MAX_ROTATION,
    TargetOption("lowest", "INS_TCALn_TMIN, where temperature is corrected, degC"),
    TargetOption("highest", "INS_TCALn_TMAX, where temperature is corrected, degC"),
)


def _parameter_names(kind: Measures, imu: int) -> tuple[str, str, str, str]:
    """Return the stems of the names of an IMU's offset, scale, device id and thermal parameters."""
    word = _WORDS[kind]
    n = "" if imu == 1 else str(imu)
    offsets = "INS_GYROFFS_" if kind == "w" and imu == 1 else f"INS_{word}{n}OFFS_"
    return offsets, f"INS_ACC{n}SCAL_", f"INS_{word}{n}_ID", f"INS_{word}{imu}_CALTEMP"


def _shifted(powers: Array, by: float) -> Array:
    """Return the coefficients of t, t², …, (k, 3), for a polynomial about another centre.

    Parameters
    ----------
    powers : (k, 3) array
        Coefficients of d, d², …, where d = t + by.
    by : float
    """
    k = len(powers)
    return np.array(
        [
            sum((comb(m, j) * powers[m - 1] * by ** (m - j) for m in range(j, k + 1)), np.zeros(3))
            for j in range(1, k + 1)
        ]
    ).reshape(k, 3)


def _render(request: Request) -> Rendering:
    model, options = request.model, request.options
    shared.require_aligned(model, "ardupilot")
    imu = options["imu"]
    reference = model.sensor.reference_temperature - ZERO_CELSIUS
    inertial = [one for one in model.triads if one[0] != "m"]
    thermal = any(triad.bias_powers.any() for _, triad in inertial)
    limits, taken = (-np.inf, np.inf), reference
    lines: list[tuple[str, float]] = []
    if thermal:
        limits = temperature_limits(
            request.ranges, "ardupilot", options["lowest"], options["highest"]
        )
        if limits[1] - limits[0] < _MIN_SPAN:
            raise InputError(
                f"ardupilot corrects over at least {_MIN_SPAN:g} K, but the range is "
                f"{limits[0]:g} to {limits[1]:g} °C",
                key="temperature",
            )
        taken = float(np.clip(reference, *limits))
        lines += [(f"INS_TCAL{imu}_ENABLE", 1)]
        lines += [(f"INS_TCAL{imu}_TMIN", limits[0]), (f"INS_TCAL{imu}_TMAX", limits[1])]
    corrections: dict[str, shared.Correction] = {}
    for kind, triad in inertial:
        offsets, scales, device, temperature = _parameter_names(kind, imu)
        powers = triad.bias_powers[:_ORDERS]
        about = _shifted(powers, _CENTRE - reference) / _UNIT
        bias = triad.bias_at(np.array([taken - reference]))[0] if thermal else triad.bias
        bias = np.where(bias == 0, _SMALLEST, bias)
        scale = 1 / np.diag(triad.matrix) if kind == "f" else np.ones(3)
        if (given := options["acc_id" if kind == "f" else "gyro_id"]) is not None:
            lines.append((device, given))
        # Parameters that the calibration does not determine keep their values on the board.
        if "bias" in triad.stated:
            lines += [(offsets + a, x) for a, x in zip("XYZ", bias, strict=True)]
        if kind == "f" and "scale" in triad.stated:
            lines += [(scales + a, x) for a, x in zip("XYZ", scale, strict=True)]
        if thermal:
            word = _WORDS[kind]
            lines += [
                (f"INS_TCAL{imu}_{word}{k}_{a}", about[k - 1, j] if k <= len(about) else 0.0)
                for k in range(1, _ORDERS + 1)
                for j, a in enumerate("XYZ")
            ]
            lines.append((temperature, taken))
        corrections[kind] = shared.parameter_correction(
            shared.single(bias),
            shared.single(scale),
            shared.single(about) * _UNIT,
            taken,
            limits,
            reference=reference,
            centre=_CENTRE,
        )
    if any(kind == "w" for kind, _ in inertial):
        lines.append(("INS_GYR_CAL", 0))
    lost: Array | None = None
    if (field := model.triad("m")) is not None:
        matrix, lost = shared.symmetric_part(field, options["max_rotation"], "ardupilot")
        offsets = -field.bias / _MILLIGAUSS
        lines += _compass_lines(matrix, offsets, options)
        corrections["m"] = shared.matrix_correction(
            shared.single(matrix), -shared.single(offsets) * _MILLIGAUSS
        )

    # Device ids have more digits than single precision can represent.
    body = "".join(
        f"{name},{value if isinstance(value, int) else shared.number(float(np.float32(value)))}\n"
        for name, value in lines
    )
    formula, remarks, reads = _inertial_text(options) if inertial else ([], [], "")
    if thermal:
        formula.append(
            "thermal = P(T - 35) - P(CALTEMP - 35), P(t) = 1e-6 (c1 t + c2 t^2 + c3 t^3), "
            "T in degC within TMIN ... TMAX"
        )
    if field is not None:
        formula.append(
            "magnetometer: m = S (SCALE (raw + OFS)), S symmetric: DIA 11 22 33, ODI 12 13 23"
        )
        reads = "; ".join(
            [reads] * bool(reads)
            + [
                "readings of the compass in T after AHRS_ORIENTATION and COMPASS_ORIENT, front "
                "right down; ArduPilot itself computes with milligauss, 1e-7 T"
            ]
        )
        remarks.append("versions that add COMPASS_MOT before the matrix need another compensation")
    return Rendering(
        shared.by_triad(model, corrections),
        shared.with_comments(body),
        tuple(formula),
        reads,
        tuple(remarks),
        rotation=lost,
    )


def _inertial_text(options: Mapping[str, Any]) -> tuple[list[str], list[str], str]:
    """Return formula, remarks and input of accelerometers and gyros."""
    formula = ["accelerometer: f = SCAL * (raw - thermal - OFFS); gyro: w = raw - thermal - OFFS"]
    remarks = ["INS_GYR_CAL 0 keeps the gyro offsets: 1 would measure them again at each boot"]
    if options["acc_id"] is None and options["gyro_id"] is None:
        remarks.append(
            "no device ids were stated (acc_id, gyro_id); make sure that this is the right board"
        )
    return formula, remarks, "readings of the driver in m/s^2 and rad/s, before AHRS_ORIENTATION"


def _compass_names(compass: int) -> tuple[str, str, str, str]:
    """Return the stems of a compass's offset, diagonal and other elements, and its scale."""
    n = "" if compass == 1 else str(compass)
    return f"COMPASS_OFS{n}_", f"COMPASS_DIA{n}_", f"COMPASS_ODI{n}_", f"COMPASS_SCALE{n}"


def _compass_lines(
    matrix: Array, offsets: Array, options: Mapping[str, Any]
) -> list[tuple[str, float]]:
    """Return the parameters of a compass, for offsets in milligauss.

    Raises
    ------
    InputError
        ArduPilot would not accept them.
    """
    compass = options["compass"]
    ofs, dia, odi, scale = _compass_names(compass)
    largest = options["offset_max"]
    lines: list[tuple[str, float]] = []
    if options["mag_id"] is not None:
        lines.append((f"COMPASS_DEV_ID{'' if compass == 1 else compass}", options["mag_id"]))
    for (a, diagonal, off), offset in zip(
        shared.symmetric_elements(matrix), offsets.tolist(), strict=True
    ):
        accepted = {
            f"{ofs}{a}": (offset, (-largest, largest)),
            f"{dia}{a}": (diagonal, _DIAGONALS),
            f"{odi}{a}": (off, _OFF_DIAGONALS),
        }
        for name, (value, limits) in accepted.items():
            shared.require_accepted("ardupilot", name, value, limits)
            lines.append((name, value))
    return [*lines, (scale, 1.0)]


def _read(text: str, options: Mapping[str, Any]) -> StatedCalibration:
    known = stated_parameters(text, "ArduPilot")
    imu = options["imu"]
    thermal = known.get(f"INS_TCAL{imu}_ENABLE") == 1
    triads: dict[Measures, StatedTriad] = {}
    references: set[float] = set()
    for kind, word in _WORDS.items():
        offsets, scales, _, temperature = _parameter_names(kind, imu)
        if not known.states(offsets + "{}"):
            continue
        bias = known.axes(offsets + "{}", 0.0)
        scale = np.ones(3) if kind == "w" else known.axes(scales + "{}", 1.0)
        if (scale == 0).any():
            raise InputError(f"{scales}X … Z contain a 0, so this accelerometer was not calibrated")
        powers = np.zeros((0, 3))
        if thermal:
            if temperature not in known:
                raise InputError(
                    f"{temperature} is missing, so the temperature of the offsets is unknown"
                )
            lowest = known.get(f"INS_TCAL{imu}_TMIN", -inf)
            highest = known.get(f"INS_TCAL{imu}_TMAX", inf)
            taken = min(max(known[temperature], lowest), highest)
            about = [
                known.axes(f"INS_TCAL{imu}_{word}{k}_{{}}", 0.0) for k in range(1, _ORDERS + 1)
            ]
            powers = _shifted(np.array(about) * _UNIT, taken - _CENTRE)
            references.add(taken + ZERO_CELSIUS)
        triads[kind] = StatedTriad(
            scale=1 / scale if kind == "f" else None, bias=bias, bias_powers=powers
        )
    ofs, dia, odi, factor = _compass_names(options["compass"])
    if known.states(ofs + "{}"):
        offset, off = known.axes(ofs + "{}", 0.0), known.axes(odi + "{}", 0.0)
        diagonal = known.axes(dia + "{}", 1.0)
        # ArduPilot applies no matrix if the diagonal is 0, and no factor if it is 0.
        diagonal, off = (diagonal, off) if diagonal.any() else (np.ones(3), np.zeros(3))
        triads["m"] = shared.stated_magnetometer(
            diagonal, off, -offset * _MILLIGAUSS, "ArduPilot", known.get(factor) or 1.0
        )
    if not triads:
        raise InputError(
            f"there are no parameters of IMU {imu} or compass {options['compass']}, such as "
            "INS_ACCOFFS_X or COMPASS_OFS_X; give parameters of ArduPilot, or another --set imu=…"
        )
    return parameter_calibration("ArduPilot", triads, references, "CALTEMP", known)


TARGET = Target(
    "ardupilot",
    "ArduPilot parameters",
    ".param",
    shared.PARAMETERS,
    _render,
    OPTIONS,
    temperature_order=_ORDERS,
)
READER = CalibrationReader("ardupilot", "ArduPilot parameter", _read, (_IMU, _COMPASS))

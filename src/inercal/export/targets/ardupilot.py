"""ArduPilot: INS parameters, and INS_TCAL where a bias depends on temperature.

    accelerometer   f = SCAL ∘ (raw − [P(T − 35) − P(T_cal − 35)] − OFFS)
    gyro            ω = raw − [P(T − 35) − P(T_cal − 35)] − OFFS
    P(t) = (c₁ t + c₂ t² + c₃ t³) 10⁻⁶, T and T_cal within TMIN … TMAX, °C

with OFFS the bias at T_cal, SCAL = 1/M_ii. The polynomial about 35 °C follows from that about the
reference T_r, Σ a_k (T − T_r)^k, by c_j = 10⁶ Σ_k (k over j) a_k (35 − T_r)^(k−j). Written from a
description of the order of operations of AP_InertialSensor (GPL-3); no line is taken from it.
"""

from collections.abc import Sequence
from math import comb

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS
from inercal.export.ranges import temperature_limits
from inercal.export.target_definition import Rendering, Request, Target, TargetOption
from inercal.export.targets.shared import (
    PARAMETERS,
    Correction,
    by_triad,
    comments,
    number,
    require_aligned,
    single,
)

CENTRE = 35.0  # °C
UNIT = 1e-6
ORDERS = 3
_MIN_SPAN = 10.0  # K
_SMALLEST = 1e-9  # an offset of exactly 0 reads as "not calibrated"

OPTIONS = (
    TargetOption("imu", "number of the IMU, 1 to 3", 1, kind=int),
    TargetOption("acc_id", "INS_ACC_ID of this board", kind=int),
    TargetOption("gyro_id", "INS_GYR_ID of this board", kind=int),
    TargetOption("lowest", "INS_TCALn_TMIN, where temperature is corrected, degC"),
    TargetOption("highest", "INS_TCALn_TMAX, where temperature is corrected, degC"),
)


def parameter_names(kind: str, imu: int) -> tuple[str, str, str, str]:
    """Return the stems of offset, scale, device id and temperature parameters of an IMU."""
    word = "ACC" if kind == "f" else "GYR"
    n = "" if imu == 1 else str(imu)
    offsets = "INS_GYROFFS_" if kind == "w" and imu == 1 else f"INS_{word}{n}OFFS_"
    return offsets, f"INS_ACC{n}SCAL_", f"INS_{word}{n}_ID", f"INS_{word}{imu}_CALTEMP"


def shifted(powers: Array, by: float) -> Array:
    """Return the coefficients of t, t², …, (k, 3), of a polynomial about another centre.

    Parameters
    ----------
    powers : (k, 3) array
        Coefficients of d, d², …; d = t + by.
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
    require_aligned(model, "ardupilot")
    imu = options["imu"]
    if not 1 <= imu <= 3:
        raise InputError(f"--set imu={imu}: give 1 to 3", key="--set", names=("imu",))
    reference = model.sensor.reference_temperature - ZERO_CELSIUS
    thermal = any(t.bias_powers.any() for _, t in model.triads)
    limits, taken = (-np.inf, np.inf), reference
    lines: list[tuple[str, float]] = []
    if thermal:
        limits = temperature_limits(
            request.ranges, "ardupilot", options["lowest"], options["highest"]
        )
        if limits[1] - limits[0] < _MIN_SPAN:
            raise InputError(
                f"ardupilot corrects over {_MIN_SPAN:g} K at least; the range is {limits[0]:g} to "
                f"{limits[1]:g} °C",
                key="temperature",
            )
        taken = float(np.clip(reference, *limits))
        lines += [(f"INS_TCAL{imu}_ENABLE", 1)]
        lines += [(f"INS_TCAL{imu}_TMIN", limits[0]), (f"INS_TCAL{imu}_TMAX", limits[1])]
    corrections: dict[str, Correction] = {}
    for kind, triad in model.triads:
        offsets, scales, device, temperature = parameter_names(kind, imu)
        powers = triad.bias_powers[:ORDERS]
        about = shifted(powers, CENTRE - reference) / UNIT
        bias = triad.bias_at(np.array([taken - reference]))[0] if thermal else triad.bias
        bias = np.where(bias == 0, _SMALLEST, bias)
        scale = 1 / np.diag(triad.matrix) if kind == "f" else np.ones(3)
        if (given := options["acc_id" if kind == "f" else "gyro_id"]) is not None:
            lines.append((device, given))
        lines += [(offsets + a, x) for a, x in zip("XYZ", bias, strict=True)]
        if kind == "f":
            lines += [(scales + a, x) for a, x in zip("XYZ", scale, strict=True)]
        if thermal:
            word = "ACC" if kind == "f" else "GYR"
            lines += [
                (f"INS_TCAL{imu}_{word}{k}_{a}", about[k - 1, j] if k <= len(about) else 0.0)
                for k in range(1, ORDERS + 1)
                for j, a in enumerate("XYZ")
            ]
            lines.append((temperature, taken))
        corrections[kind] = _correction(bias, scale, about, reference, taken, limits)
    if any(kind == "w" for kind, _ in model.triads):
        lines.append(("INS_GYR_CAL", 0))

    def write(header: Sequence[str]) -> str:
        # Device ids have more digits than single precision.
        values = (
            str(value) if isinstance(value, int) else number(single(value).item())
            for _, value in lines
        )
        rows = (f"{name},{text}\n" for (name, _), text in zip(lines, values, strict=True))
        return comments(header, "#") + "".join(rows)

    formula = ["accelerometer: f = SCAL * (raw - thermal - OFFS); gyro: w = raw - thermal - OFFS"]
    if thermal:
        formula.append(
            "thermal = P(T - 35) - P(CALTEMP - 35), P(t) = 1e-6 (c1 t + c2 t^2 + c3 t^3), "
            "T in degC within TMIN ... TMAX"
        )
    remarks = ["INS_GYR_CAL 0 keeps the gyro offsets: 1 would measure them anew at each boot"]
    if options["acc_id"] is None and options["gyro_id"] is None:
        remarks.append("no device ids were stated (acc_id, gyro_id): check that the board is this")
    return Rendering(
        by_triad(model, corrections),
        write,
        tuple(formula),
        "readings of the driver in m/s^2 and rad/s, before AHRS_ORIENTATION",
        tuple(remarks),
    )


def _correction(
    bias: Array,
    scale: Array,
    about: Array,
    reference: float,
    taken: float,
    limits: tuple[float, float],
):
    offset, factor, terms = single(bias), single(scale), single(about) * UNIT

    def polynomial(t: Array) -> Array:
        return sum(
            (t[:, None] ** k * line for k, line in enumerate(terms, start=1)),
            np.zeros((t.size, 3)),
        )

    def correct(y: Array, dT: Array) -> Array:
        t = np.clip(dT + reference, *limits) - CENTRE
        thermal = polynomial(t) - polynomial(np.array([taken - CENTRE]))
        return factor * (y - thermal - offset)

    return correct


TARGET = Target(
    "ardupilot",
    "ArduPilot parameters",
    ".param",
    PARAMETERS,
    _render,
    OPTIONS,
    temperature_order=ORDERS,
)

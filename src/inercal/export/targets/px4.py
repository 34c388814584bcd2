"""PX4: parameters for accelerometers, gyros and magnetometers, to load in QGroundControl.

    accelerometer   f = SCALE ∘ (raw − thermal − OFF)
    gyro            ω = raw − thermal − OFF
    thermal         X1 Δ + X2 Δ² + X3 Δ³ + X0,  Δ = T − TREF, T within TMIN … TMAX
    magnetometer    m = S (raw − OFF), gauss

OFF is the bias, and SCALE = 1/M_ii. S is symmetric: XSCALE, YSCALE and ZSCALE are its diagonal, and
XODIAG, YODIAG and ZODIAG its elements 12, 13 and 23. It is P⁻¹ in D = P Q; PX4 has no place for the
rotation Q. Source: the classes of src/lib/sensor_calibration and
src/modules/temperature_compensation of PX4-Autopilot (BSD-3), described in words. The reader
accepts every format of `parameter_files` and adds X0 to the bias.
"""

from collections.abc import Mapping
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

_INTEGER, _REAL = 6, 9  # MAV_PARAM_TYPE
_NAMES: dict[Measures, tuple[str, str]] = {"f": ("ACC", "A"), "w": ("GYRO", "G"), "m": ("MAG", "M")}
_IDS = {"f": "acc_id", "w": "gyro_id", "m": "mag_id"}
_GAUSS = 1e-4  # T
_MAG_SCALES = (0.1, 3.0)  # range of CAL_MAGn_XSCALE in its definition
_ORDERS = 3
_SETS = 4  # number of thermal parameters
_INSTANCE = TargetOption(
    "instance", "n of CAL_ACCn, CAL_GYROn and CAL_MAGn", 0, kind=int, limits=(0, _SETS - 1)
)

OPTIONS = (
    *(
        TargetOption(
            f"{word.lower()}_id",
            f"device id of the {device}, CAL_{word}n_ID of this board",
            kind=int,
            limits=DEVICE_ID,
        )
        for word, device in (("ACC", "accelerometer"), ("GYRO", "gyro"), ("MAG", "magnetometer"))
    ),
    _INSTANCE,
    TargetOption("priority", "CAL_ACCn_PRIO", 50, kind=int, limits=(-1, 100)),
    *(
        TargetOption(
            f"{before}rotation",
            f"CAL_{word}n_ROT; -1 for a sensor on the board",
            -1,
            kind=int,
            limits=(-1, 100),  # up to 40, and 100 for stated angles
        )
        for before, word in (("", "ACC"), ("mag_", "MAG"))
    ),
    shared.MAX_ROTATION,
    TargetOption("lowest", "TC_An_TMIN, where temperature is corrected, degC"),
    TargetOption("highest", "TC_An_TMAX, where temperature is corrected, degC"),
)


def _render(request: Request) -> Rendering:
    model, options = request.model, request.options
    shared.require_aligned(model, "px4")
    n = options["instance"]
    lines: list[tuple[str, float, int]] = []
    corrections: dict[str, shared.Correction] = {}
    limits = (-np.inf, np.inf)
    lost: Array | None = None
    thermal_kinds = [t for kind, t in model.triads if kind != "m"]
    if model.sensor.uses("dT") and any(t.bias_powers.any() for t in thermal_kinds):
        limits = temperature_limits(request.ranges, "px4", options["lowest"], options["highest"])
    reference = model.sensor.reference_temperature - ZERO_CELSIUS
    for kind, triad in model.triads:
        word, letter = _NAMES[kind]
        device = shared.needed(options, OPTIONS, _IDS[kind], "px4")
        prefix = f"CAL_{word}{n}_"
        lines += [
            (prefix + "ID", device, _INTEGER),
            (prefix + "PRIO", options["priority"], _INTEGER),
            (prefix + "ROT", options["mag_rotation" if kind == "m" else "rotation"], _INTEGER),
        ]
        if kind == "m":
            matrix, lost = shared.symmetric_part(triad, options["max_rotation"], "px4")
            offset = triad.bias / _GAUSS
            for (a, scale, off), x in zip(shared.symmetric_elements(matrix), offset, strict=True):
                shared.require_accepted("px4", f"{prefix}{a}SCALE", scale, _MAG_SCALES)
                values = {"OFF": x, "SCALE": scale, "ODIAG": off}
                lines += [(f"{prefix}{a}{word}", value, _REAL) for word, value in values.items()]
            corrections[kind] = shared.matrix_correction(
                shared.single(matrix), shared.single(offset) * _GAUSS
            )
            continue
        # Parameters that the calibration does not determine keep their values on the board.
        if "bias" in triad.stated:
            lines += [(f"{prefix}{a}OFF", x, _REAL) for a, x in zip("XYZ", triad.bias, strict=True)]
        scale = 1 / np.diag(triad.matrix) if kind == "f" else np.ones(3)
        if kind == "f" and "scale" in triad.stated:
            lines += [(f"{prefix}{a}SCALE", x, _REAL) for a, x in zip("XYZ", scale, strict=True)]
        powers = triad.bias_powers[:_ORDERS]
        if powers.any():
            thermal = f"TC_{letter}{n}_"
            lines += [(f"TC_{letter}_ENABLE", 1, _INTEGER), (thermal + "ID", device, _INTEGER)]
            lines += [
                (f"{thermal}X{k}_{a}", powers[k - 1, a] if 0 < k <= len(powers) else 0.0, _REAL)
                for k in range(_ORDERS + 1)
                for a in range(3)
            ]
            ends = (("TREF", reference), ("TMIN", limits[0]), ("TMAX", limits[1]))
            lines += [(thermal + name, value, _REAL) for name, value in ends]
        corrections[kind] = shared.parameter_correction(
            shared.single(triad.bias),
            shared.single(scale),
            shared.single(powers),
            reference,
            limits,
            reference=reference,
            centre=reference,
        )
    body = "#\n# Vehicle\tComponent\tName\tValue\tType\n" + "".join(
        f"1\t1\t{name}\t{shared.number(value) if sort == _REAL else int(value)}\t{sort}\n"
        for name, value, sort in lines
    )
    formula: list[str] = []
    reads = (
        "readings of the driver in m/s^2 and rad/s, axes of the sensor before the board's rotation"
    )
    if thermal_kinds:
        formula = [
            "accelerometer: f = SCALE * (raw - thermal - OFF); gyro: w = raw - thermal - OFF"
        ]
    if model.triad("m") is not None:
        reads = (
            "readings of the driver, axes of the sensor before the board's rotation, in SI: PX4 "
            "itself computes with gauss, 1e-4 T"
        )
        formula.append(
            "magnetometer: m = S (raw - OFF), S symmetric: SCALE 11 22 33, ODIAG 12 13 23"
        )
    if np.isfinite(limits[0]):
        formula.append(
            "thermal = X1 D + X2 D^2 + X3 D^3 + X0, D = T - TREF in K, T within TMIN ... TMAX"
        )
    return Rendering(
        shared.by_triad(model, corrections),
        shared.with_comments(body),
        tuple(formula),
        reads,
        (
            "PX4 rotates the result by SENS_BOARD_ROT or CAL_*_ROT afterwards; it has no gyro "
            "scale",
            "the ids must be those of this board's sensors, otherwise PX4 ignores the set",
        ),
        rotation=lost,
    )


def _read(text: str, options: Mapping[str, Any]) -> StatedCalibration:
    known = stated_parameters(text, "PX4")
    n = options["instance"]
    triads: dict[Measures, StatedTriad] = {}
    references: set[float] = set()
    for kind, (word, letter) in _NAMES.items():
        stem = f"CAL_{word}{n}_"
        if not known.states(f"{stem}{{}}OFF"):
            continue
        bias = known.axes(f"{stem}{{}}OFF", 0.0)
        scale = np.ones(3) if kind == "w" else known.axes(f"{stem}{{}}SCALE", 1.0)
        if kind == "m":
            off = known.axes(f"{stem}{{}}ODIAG", 0.0)
            triads[kind] = shared.stated_magnetometer(scale, off, bias * _GAUSS, "PX4")
            continue
        if (scale == 0).any():
            raise InputError(f"{stem}XSCALE … ZSCALE contain a 0, but they must be near 1")
        powers = np.zeros((0, 3))
        if (thermal := _thermal_set(known, letter, known.get(f"{stem}ID"))) is not None:
            names = [[f"{thermal}X{k}_{a}" for a in range(3)] for k in range(_ORDERS + 1)]
            table = np.array([[known.value(name, 0.0) for name in row] for row in names])
            bias, powers = bias + table[0], table[1:]
            references.add(known.value(f"{thermal}TREF", 25.0) + ZERO_CELSIUS)
        triads[kind] = StatedTriad(
            scale=1 / scale if kind == "f" else None, bias=bias, bias_powers=powers
        )
    if not triads:
        raise InputError(
            f"there are no parameters CAL_ACC{n}_XOFF, CAL_GYRO{n}_XOFF or CAL_MAG{n}_XOFF; give "
            "parameters of PX4, or another --set instance=…"
        )
    return parameter_calibration("PX4", triads, references, "TREF", known)


def _thermal_set(known: Mapping[str, float], letter: str, device: float | None) -> str | None:
    """Return the stem of the names of a device's active thermal parameters."""
    if device is None or known.get(f"TC_{letter}_ENABLE") != 1:
        return None
    stems = [f"TC_{letter}{m}_" for m in range(_SETS)]
    return next((stem for stem in stems if known.get(f"{stem}ID") == device), None)


TARGET = Target(
    "px4",
    "PX4 parameters (QGroundControl)",
    ".params",
    shared.PARAMETERS,
    _render,
    OPTIONS,
    temperature_order=_ORDERS,
)
READER = CalibrationReader("px4", "PX4 parameter", _read, (_INSTANCE,))

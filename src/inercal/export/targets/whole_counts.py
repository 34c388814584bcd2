"""Betaflight and INAV: commands for the CLI, with zeros and gains in whole counts.

    Betaflight   x = raw − zero                       accelerometers and magnetometers
    INAV         f = (raw − acczero) accgain / 4096   ω = raw − gyro_zero
                 m = (raw − magzero) 1024 / maggain

With the size of a count d, zero = b / d, accgain = 4096 / M_ii and maggain = 1024 M_ii, rounded.
For accelerometers, d = 9.80665 m/s² / acc_1G; the driver of the chip fixes acc_1G, the counts at
1 g. Betaflight subtracts after it has turned the readings to the axes of the
board, INAV before. If INAV is to keep `gyro_zero`, `init_gyro_cal` must be OFF, and INAV then also
takes gravity from `ins_gravity_cmss`. Sources: acceleration.c, compass.c and settings.c of
betaflight/betaflight; acceleration.c, compass.c, gyro.c, navigation_pos_estimator.c and Settings.md
of iNavFlight/inav (all GPL-3), described in words, from which no code was copied.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.export.parameter_files import assumed_note
from inercal.export.reader_definition import CalibrationReader, StatedCalibration, StatedTriad
from inercal.export.target_definition import STEP, Rendering, Request, Target, TargetOption
from inercal.export.targets import shared
from inercal.physics.quantities import QUANTITIES, Measures
from inercal.physics.sensors import G0

_COUNTS: dict[Measures, TargetOption] = {
    "f": TargetOption("acc_1g", "counts of the firmware at 1 g, such as 2048", limits=STEP),
    "w": TargetOption(
        "gyro_lsb", "size of a count of the gyros, '0.061 deg/s'", like="rad/s", limits=STEP
    ),
    "m": TargetOption(
        "mag_lsb", "size of a count of the magnetometers, '0.15 uT'", like="T", limits=STEP
    ),
}
_GRAVITY = TargetOption(
    "gravity", "gravity where INAV is used, '9.81 m/s^2'", G0, like="m/s^2", limits=(0, 20)
)
_FIELD = TargetOption(
    "field", "strength of the field at INAV's calibration, '48 uT'", like="T", limits=STEP
)
_INT16 = (-(1 << 15), (1 << 15) - 1)
_NAMES = {"f": ("acczero", "accgain"), "w": ("gyro_zero", ""), "m": ("magzero", "maggain")}
_ACC_ONE, _MAG_ONE = 4096, 1024
_READINGS = (
    "counts of the firmware, converted to m/s^2, rad/s and T with the stated sizes of a count"
)


def _step(kind: Measures, options: Mapping[str, Any], program: str) -> float:
    """Return the size of a count, SI."""
    value = shared.needed(options, tuple(_COUNTS.values()), _COUNTS[kind].name, program)
    return G0 / value if kind == "f" else value


def _whole(name: str, values: Array) -> list[int]:
    """Return whole numbers within the limits of a setting."""
    low, high = _INT16
    found = [int(x) for x in np.rint(values)]
    for x in found:
        if not low <= x <= high:
            raise InputError(
                f"{name} would be {x}, but it must be between {low} and {high}; check the stated "
                "size of a count",
                names=(name,),
            )
    return found


def _correction(zero: Sequence[int], step: float, factor: Array) -> shared.Correction:
    bias = np.array(zero) * step
    return lambda y, dT: factor * (y - bias)


def _rendering(
    request: Request,
    corrections: Mapping[str, shared.Correction],
    lines: Sequence[str],
    formula: str,
    *remarks: str,
) -> Rendering:
    return Rendering(
        shared.by_triad(request.model, corrections),
        shared.with_comments("\n".join([*lines, "save"]) + "\n"),
        (formula,),
        _READINGS,
        (*remarks, "paste the lines into the CLI; other lines of the settings stay as they are"),
    )


def _render_betaflight(request: Request) -> Rendering:
    model = request.model
    shared.require_aligned(model, "betaflight")
    lines: list[str] = []
    corrections: dict[str, shared.Correction] = {}
    for kind, triad in model.triads:
        if kind == "w" or "bias" not in triad.stated:
            continue
        name, end = ("acc_calibration", [1]) if kind == "f" else ("mag_calibration", [])
        step = _step(kind, request.options, "betaflight")
        zero = _whole(name, triad.bias / step)
        lines.append(f"set {name} = {','.join(map(str, zero + end))}")
        corrections[kind] = _correction(zero, step, np.ones(3))
    if not lines:
        model.require("f", "betaflight")
        raise InputError("betaflight takes only biases, but the calibration determines none")
    return _rendering(
        request,
        corrections,
        lines,
        "x = raw - zero, in counts",
        "the axes must be those of the board, because Betaflight subtracts the zeros after the "
        "alignment of the sensor and of the board (use --axes)",
        *("Betaflight has no settings for gyros; it measures their zeros at each start",)
        * (model.triad("w") is not None),
    )


def _render_inav(request: Request) -> Rendering:
    model = request.model
    shared.require_aligned(model, "inav")
    lines: list[str] = []
    corrections: dict[str, shared.Correction] = {}
    for kind, triad in model.triads:
        name, gain_name = _NAMES[kind]
        step = _step(kind, request.options, "inav")
        zero = _whole(name, triad.bias / step)
        factor = np.ones(3)
        settings = {name: zero} if "bias" in triad.stated else {}
        if gain_name:
            diagonal = np.diag(triad.matrix)
            wanted = _ACC_ONE / diagonal if kind == "f" else _MAG_ONE * diagonal
            # Aligned axes have 0.5 < M_ii < 1.5, so the gains are within INAV's limits.
            gain = _whole(gain_name, wanted)
            factor = np.array(gain) / _ACC_ONE if kind == "f" else _MAG_ONE / np.array(gain)
            if "scale" in triad.stated:
                settings[gain_name] = gain
        else:
            gravity = shared.number(100 * request.options["gravity"], 7)
            lines += ["set init_gyro_cal = OFF", f"set ins_gravity_cmss = {gravity}"]
        lines += [
            f"set {setting}_{axis} = {value}"
            for setting, values in settings.items()
            for axis, value in zip("xyz", values, strict=True)
        ]
        corrections[kind] = _correction(zero, step, factor)
    return _rendering(
        request,
        corrections,
        lines,
        "f = (raw - acczero) accgain / 4096; w = raw - gyro_zero; m = (raw - magzero) 1024 / "
        "maggain, in counts",
        "the axes must be those of the chips, because INAV applies these numbers before the "
        "alignment of the sensor and of the board",
        "versions of INAV that compute in whole counts also drop the fraction of a count after "
        "the gain",
    )


def _cli_settings(text: str) -> dict[str, str]:
    """Return the values of `set NAME = VALUE` lines by name; the last value of a name applies."""
    found = re.findall(r"^\s*set\s+(\w+)\s*=\s*(.*?)\s*$", text, re.MULTILINE)
    return {name.lower(): value for name, value in found}


def _setting(settings: Mapping[str, str], name: str, default: str = "") -> list[float]:
    """Return the numbers of a setting."""
    value = settings.get(name, default)
    try:
        return [float(int(x)) for x in value.split(",")]
    except ValueError:
        raise InputError(f"{name} = {value} is not a whole number", names=(name,)) from None


def _imported(
    program: str,
    stated: Mapping[Measures, tuple[list[float], Array | None]],
    options: Mapping[str, Any],
    notes: Sequence[str],
) -> StatedCalibration:
    """Return the calibration with zeros in counts and the diagonals of the matrices."""
    if not stated:
        raise InputError(
            f"no line sets a calibration of {program}; give the output of diff or dump of its CLI"
        )
    names = [_COUNTS[kind].name for kind in stated]
    if all(options[name] is None for name in names):
        missing = " or ".join(f"--set {name}=… ({_COUNTS[kind].meaning})"
                              for kind, name in zip(stated, names, strict=True))  # fmt: skip
        raise InputError(f"{program} needs {missing}", key="--set", names=tuple(names))
    triads: dict[Measures, StatedTriad] = {}
    more: list[str] = []
    for kind, (zero, diagonal) in stated.items():
        if options[_COUNTS[kind].name] is None:
            more.append(
                f"the {QUANTITIES[kind].sensors} of the file are left out, because "
                f"{_COUNTS[kind].name} is not stated"
            )
            continue
        if len(zero) != len("xyz"):
            raise InputError(f"the {QUANTITIES[kind].sensors} of {program} need three zeros")
        bias = np.array(zero) * _step(kind, options, program)
        triads[kind] = StatedTriad(bias=bias, scale=diagonal)
    return StatedCalibration(
        triads,
        notes=(*notes, *more, f"{program} states whole counts and no misalignment"),
    )


def _read_betaflight(text: str, options: Mapping[str, Any]) -> StatedCalibration:
    settings = _cli_settings(text)
    stated: dict[Measures, tuple[list[float], Array | None]] = {}
    acc = _setting(settings, "acc_calibration", "0,0,0,0")
    if acc[3:] != [0.0]:  # the fourth number states whether a calibration was made
        stated["f"] = acc[:3], None
    if any(mag := _setting(settings, "mag_calibration", "0,0,0")):
        stated["m"] = mag, None
    return _imported("Betaflight", stated, options, ("Betaflight states no scale factors",))


def _read_inav(text: str, options: Mapping[str, Any]) -> StatedCalibration:
    settings = _cli_settings(text)
    stated: dict[Measures, tuple[list[float], Array | None]] = {}
    notes: list[str] = []
    assumed: dict[str, float] = {}
    for kind in _COUNTS:
        name, gain_name = _NAMES[kind]
        prefixes = tuple(f"{one}_" for one in (name, gain_name) if one)
        if not any(one.startswith(prefixes) for one in settings):
            continue
        zero = [x for a in "xyz" for x in _setting(settings, f"{name}_{a}", "0")]
        one = _ACC_ONE if kind == "f" else _MAG_ONE
        gain = [x for a in "xyz" for x in _setting(settings, f"{gain_name}_{a}", str(one))]
        defaults = {name: 0, gain_name: one} if gain_name else {name: 0}
        assumed |= {
            f"{setting}_{a}": default
            for setting, default in defaults.items()
            for a in "xyz"
            if f"{setting}_{a}" not in settings
        }
        if gain_name and min(gain) <= 0:
            raise InputError(f"{gain_name} must be above 0", names=(gain_name,))
        diagonal = _ACC_ONE / np.array(gain) if kind == "f" else None
        if kind == "m" and options["field"] is not None and options["mag_lsb"] is not None:
            diagonal = np.array(gain) * options["mag_lsb"] / options["field"]
        elif kind == "m":
            notes.append("maggain needs --set field=…, so no scale of magnetometers is imported")
        stated[kind] = zero, diagonal
    if "w" in stated and settings.get("init_gyro_cal", "ON").upper() != "OFF":
        notes.append("init_gyro_cal is ON, so INAV measures gyro_zero again at each start")
    return _imported("INAV", stated, options, (*notes, *assumed_note("INAV", assumed)))


_BETAFLIGHT_OPTIONS = (_COUNTS["f"], _COUNTS["m"])
_INAV_OPTIONS = tuple(_COUNTS.values())
_ZEROS = {"f": shared.BIAS, "m": shared.BIAS}
_GAINS = {"f": shared.BIAS_AND_SCALE, "w": shared.BIAS, "m": shared.BIAS_AND_SCALE}
BETAFLIGHT = Target(
    "betaflight", "Betaflight CLI commands", ".txt", _ZEROS, _render_betaflight, _BETAFLIGHT_OPTIONS
)
INAV = Target("inav", "INAV CLI commands", ".txt", _GAINS, _render_inav, (*_INAV_OPTIONS, _GRAVITY))
BETAFLIGHT_READER = CalibrationReader(
    "betaflight", "Betaflight CLI output", _read_betaflight, _BETAFLIGHT_OPTIONS
)
INAV_READER = CalibrationReader("inav", "INAV CLI output", _read_inav, (*_INAV_OPTIONS, _FIELD))

"""Formats for magnetometers only: magcal of MATLAB, magnetometer_pipeline of ROS, and x-io Fusion.

    magcal                  C = (m − b) A           rows; A = s Sᵀ, b = oᵀ
    magnetometer_pipeline   h = S (m − bias)        tesla
    Fusion                  h = S (m − offset)

S = D⁻¹. magcal and Fusion keep the unit of the sensor's output, so that s is its nominal scale per
tesla: expmfs is the strength of the field in this unit. Sources: the documentation of magcal
(Navigation Toolbox); bias_remover.cpp of ctu-vras/compass (BSD-3), which subtracts the bias first
and reads `initial_mag_scaling_matrix`, although its documentation says `initial_scaling_matrix`;
FusionModel.h of xioTechnologies/Fusion (MIT). All were described in words.
"""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import si_factor
from inercal.export.parameter_files import assumed_note
from inercal.export.reader_definition import CalibrationReader, StatedCalibration, StatedTriad
from inercal.export.target_definition import Rendering, Request, Target, TargetOption
from inercal.export.targets import shared
from inercal.export.targets.c_headers import literal

_HOLDS = {"m": shared.MATRIX}
_DIGITS = 12
_BIAS = "initial_mag_bias_"
_MATRICES = ("initial_mag_scaling_matrix", "initial_scaling_matrix")
_ROS = TargetOption("ros", "version of ROS: 1 or 2", "2", kind=str, choices=("1", "2"))
_UNIT = TargetOption("unit", "unit of the readings: uT, or LSB if field is stated", "uT", kind=str)
_EXPMFS = TargetOption("expmfs", "expected field strength of magcal, in the unit of the readings")
_FIELD = TargetOption("field", "strength of the field there, such as '48.6 uT'", like="T")


def _rendering(
    request: Request,
    target: str,
    rounded: Callable[[Array], Array],
    write: Callable[[Array, Array, Sequence[str]], str],
    formula: str,
    remark: str,
) -> Rendering:
    """Return the rendering of a file in output units, with its numbers as written.

    `write` makes the text of S, the offset and the lines of explanation.
    """
    triad = request.model.require("m", target)
    scale = float(triad.scale[0])
    matrix = rounded(scale * triad.correction / triad.scale)
    offset = rounded(triad.offset + triad.scale * triad.bias)
    return Rendering(
        lambda y, dT: (request.model.outputs(y) - offset) @ matrix.T / scale,
        partial(write, matrix, offset),
        (formula,),
        shared.output_text(triad),
        (f"the result is in the unit of the readings: {scale:.9g} {triad.unit} are 1 T", remark),
        takes_output=True,
    )


def _magcal_text(matrix: Array, offset: Array, header: Sequence[str]) -> str:
    content = {"comment": "\n".join(header), "A": matrix.T.tolist(), "b": offset.tolist()}
    return json.dumps(content, indent=1) + "\n"


def _render_magcal(request: Request) -> Rendering:
    remark = (
        "in MATLAB: c = jsondecode(fileread(file)); C = (m - c.b') * c.A; expmfs is the strength "
        "of the field in the unit of the readings"
    )
    formula = "C = (m - b) A, m and b are rows"
    return _rendering(request, "magcal", np.asarray, _magcal_text, formula, remark)


def _fusion_text(soft: Array, hard: Array, header: Sequence[str]) -> str:
    elements = [
        f".element.{a}{b} = {literal(float(soft[i, j]))}"
        for i, a in enumerate("xyz")
        for j, b in enumerate("xyz")
    ]
    axes = [f".axis.{a} = {literal(float(x))}" for a, x in zip("xyz", hard, strict=True)]
    comment = "".join(f" * {line}".rstrip() + "\n" for line in header)
    lines = [
        "static const FusionMatrix softIronMatrix = {",
        *(f"    {element}," for element in elements),
        "};",
        f"static const FusionVector hardIronOffset = {{{', '.join(axes)}}};",
    ]
    return f"/*\n{comment} */\n" + "\n".join(lines) + "\n"


def _render_fusion(request: Request) -> Rendering:
    remark = (
        "pass both to FusionModelMagnetic, or to FusionCalibrationMagnetic of older versions; "
        "include FusionMath.h first"
    )
    formula = "m = softIronMatrix (raw - hardIronOffset)"
    return _rendering(request, "fusion", shared.single, _fusion_text, formula, remark)


def _render_ros(request: Request) -> Rendering:
    triad = request.model.require("m", "ros_magnetometer")
    matrix, bias = (shared.written(x, _DIGITS) for x in (triad.correction, triad.bias))
    lines = [
        f"{_BIAS}{a}: {shared.yaml_number(x, _DIGITS)}" for a, x in zip("xyz", bias, strict=True)
    ]
    lines += [f"{name}: [{shared.yaml_row(matrix.ravel(), _DIGITS)}]" for name in _MATRICES]
    if request.options["ros"] == "2":
        lines = ["/**:", "  ros__parameters:", *(f"    {line}" for line in lines)]
    return Rendering(
        shared.by_triad(request.model, {"m": shared.matrix_correction(matrix, bias)}),
        shared.with_comments("\n".join(lines) + "\n"),
        ("m = S (raw - bias), S by rows",),
        "readings of sensor_msgs/MagneticField in T",
        (
            "parameters of magnetometer_bias_remover; its code reads initial_mag_scaling_matrix, "
            "and its documentation names the same numbers initial_scaling_matrix",
        ),
    )


def _stated(matrix: Array, bias: Array, *notes: str, unit: str | None = None) -> StatedCalibration:
    """Return magnetometers with the correction S (m − bias), after checks of both."""
    if not (np.isfinite(matrix).all() and np.isfinite(bias).all()):
        raise InputError("the matrix and the offset must be finite numbers")
    if np.linalg.cond(matrix) > 1 / np.finfo(np.float32).eps:
        raise InputError("the matrix has no inverse, so it cannot be a correction")
    return StatedCalibration(
        {"m": StatedTriad(matrix=shared.inverse(matrix), bias=bias)},
        output=unit is not None,
        units=None if unit is None else ("", "", unit),
        notes=notes,
    )


def _read_magcal(text: str, options: Mapping[str, Any]) -> StatedCalibration:
    try:
        content = json.loads(text)
        matrix, bias = (np.array(content[name], dtype=float) for name in ("A", "b"))
        strength = float(content.get("expmfs", 0.0))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(
            f"this is no JSON of A and b of magcal: {type(error).__name__} {error}; write it with "
            "jsonencode(struct('A', A, 'b', b, 'expmfs', expmfs))"
        ) from None
    if matrix.shape != (3, 3) or bias.size != 3:
        raise InputError("A must be 3 × 3 numbers, and b 3 numbers", names=("A", "b"))
    given, field = options["expmfs"] or strength, options["field"]
    if field is None:
        factor = si_factor(options["unit"], like="T")
        note = f"corrected readings are taken as a field in {options['unit']}"
        return _stated(matrix.T * factor, bias.ravel(), note, unit=options["unit"])
    if not (given > 0 and field > 0):
        raise InputError(
            "the scale of A needs a field strength above 0: give expmfs in the file or "
            "--set expmfs=…, and --set field=…",
            key="--set",
            names=("expmfs", "field"),
        )
    note = f"scaled so that expmfs {given:.6g} is a field of {field * 1e6:.6g} µT"
    return _stated(matrix.T * field / given, bias.ravel(), note, unit=options["unit"])


def _read_ros(text: str, options: Mapping[str, Any]) -> StatedCalibration:
    plain = re.sub(r"#.*", "", text)
    try:
        found = [re.search(rf"\b{_BIAS}{a}\s*:\s*([-+.\deE]+)", plain) for a in "xyz"]
        bias = np.array([float(one[1]) if one else 0.0 for one in found])
        rows = re.search(rf"\b(?:{'|'.join(_MATRICES)})\s*:\s*\[([^\]]*)\]", plain)
        matrix = np.eye(3) if rows is None else np.array([float(x) for x in rows[1].split(",")])
        if matrix.size != 9 or not any(found):
            raise ValueError
    except ValueError:
        raise InputError(
            f"these are no parameters of magnetometer_bias_remover: give {_BIAS}x, _y and _z, and "
            f"{_MATRICES[0]} with 9 numbers"
        ) from None
    assumed = {_BIAS + a: 0.0 for a, one in zip("xyz", found, strict=True) if one is None}
    if rows is None:
        assumed |= {f"{_MATRICES[0]}[{k}]": float(k % 4 == 0) for k in range(9)}
    note = "readings of sensor_msgs/MagneticField, in T"
    return _stated(
        matrix.reshape(3, 3), bias, note, *assumed_note("magnetometer_bias_remover", assumed)
    )


MAGCAL = Target("magcal", "A and b of magcal (MATLAB), JSON", ".json", _HOLDS, _render_magcal)
ROS = Target("ros_magnetometer", "ROS magnetometer_pipeline parameters", ".yaml", _HOLDS,
             _render_ros, (_ROS,))  # fmt: skip
FUSION = Target("fusion", "x-io Fusion soft and hard iron", ".h", _HOLDS, _render_fusion)
MAGCAL_READER = CalibrationReader(
    "magcal", "A and b of magcal", _read_magcal, (_UNIT, _EXPMFS, _FIELD)
)
ROS_READER = CalibrationReader("ros_magnetometer", "magnetometer_pipeline parameter", _read_ros)

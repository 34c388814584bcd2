"""Kalibr and OpenVINS: IMU files with triangular matrices, and import of Kalibr's files.

    Kalibr     y = M f + b,   y_g = M_g C_gyro_i ω + A C_gyro_i f + b_g
    OpenVINS   f = R_ACCtoIMU Ta⁻¹ (y − b),   ω = R_GYROtoIMU Tw⁻¹ (y_g − b_g − Tg f)

In the IMU frame of both programs, x lies along the accelerometer's x axis, and y lies in the plane
of its x and y axes. With M = L Q (L is lower triangular, Q is a rotation), Q converts body axes to
this frame, in which y = L f + b. The gyro has a separate frame: G Qᵀ = L_g C_g, and y_g = L_g C_g ω
+ A_body Qᵀ f + b_g. For Kalibr, this gives M = L, M_g = L_g, C_gyro_i = C_g and A = A_body Qᵀ C_gᵀ,
because A acts on the force rotated into the gyro's frame. For OpenVINS, Ta = L, R_IMUtoACC = I, Tw
= L_g, R_IMUtoGYRO = C_g and Tg = A_body Qᵀ, because Tg acts on the force in the IMU frame. Sources:
IccSensors.py of ethz-asl/kalibr (BSD), described in words; a description of ov_msckf and ov_core
(GPL-3), from which no code was copied. Kalibr's files contain no biases. The user states the noise
densities that both programs need.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, require_extra
from inercal.basics.small_files import read_small_file
from inercal.export.model import ExportModel
from inercal.export.reader_definition import CalibrationReader, StatedCalibration, StatedTriad
from inercal.export.target_definition import Rendering, Request, Target, TargetOption
from inercal.export.targets import shared
from inercal.export.term_kinds import TermKind
from inercal.physics import frames

_HOLDS: dict[str, frozenset[TermKind]] = {
    "f": frozenset({"scale", "misalignment"}),
    "w": frozenset({"scale", "misalignment", "g"}),
}
_KEYS = {
    "accelerometer_noise_density": "m/s^2/sqrt(Hz)",
    "accelerometer_random_walk": "m/s^3/sqrt(Hz)",
    "gyroscope_noise_density": "rad/s/sqrt(Hz)",
    "gyroscope_random_walk": "rad/s^2/sqrt(Hz)",
    "update_rate": "Hz",
}
_PRINTED_IMU = re.compile(r"^IMU(\d+):\n(.*?)(?=^IMU\d+:|\Z)", re.MULTILINE | re.DOTALL)
_PRINTED_MATRIX = re.compile(r"\b(M|A|C_gyro_i|r[xyz]_i)\b[^\n:]*:\s*\n(\s*\[[\[\]\d\s.eE+-]*\])")
_PRINTED_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_LARGEST = 1 << 20  # largest size of a noise file, bytes
NOISE_OPTIONS = (
    *(TargetOption(name, f"{unit}; or in the file of noise") for name, unit in _KEYS.items()),
    TargetOption("noise", "imu.yaml of a noise analysis, with these keys", kind=str),
)
_OPTIONS = (*NOISE_OPTIONS, TargetOption("rostopic", "topic of the IMU", "/imu0", kind=str))


@dataclass(frozen=True, eq=False)
class _TriangularModel:
    """The matrices L, Q, L_g, C_g and A Qᵀ as written to the file, all (3, 3)."""

    accelerometer: Array
    turn: Array
    gyro: Array
    gyro_turn: Array
    sensitivity: Array

    def correction(self, bias: Array, gyro_bias: Array):
        """Return the correction in the calibration's frame, from the matrices in the file."""
        back = np.linalg.inv(self.accelerometer)
        back_g = self.gyro_turn.T @ np.linalg.inv(self.gyro)

        def correct(readings: Array, dT: Array) -> Array:
            f = (readings[:, :3] - bias) @ back.T
            w = (readings[:, 3:] - gyro_bias - f @ self.sensitivity.T) @ back_g.T
            return np.concatenate([f @ self.turn, w @ self.turn], axis=-1)

        return correct


def _triangular_model(model: ExportModel, target: str) -> _TriangularModel:
    acc, gyro = model.require("f", target), model.require("w", target)
    shared.require_aligned(model, target)
    lower, turn = frames.decompose_triangular(acc.matrix)
    lower_g, turn_g = frames.decompose_triangular(gyro.matrix @ turn.T)
    sensitivity = model.g_sensitivity @ turn.T
    return _TriangularModel(
        *(shared.written(m, 12) for m in (lower, turn, lower_g, turn_g, sensitivity))
    )


def _render_kalibr(request: Request) -> Rendering:
    one = _triangular_model(request.model, "kalibr")
    lines = [
        *_head_lines(request, "kalibr", "scale-misalignment"),
        "  accelerometers:",
        *_yaml_matrix("M", one.accelerometer, "    "),
        "  gyroscopes:",
        *_yaml_matrix("M", one.gyro, "    "),
        *_yaml_matrix("A", shared.written(one.sensitivity @ one.gyro_turn.T, 12), "    "),
        *_yaml_matrix("C_gyro_i", one.gyro_turn, "    "),
    ]
    return _rendering(
        request,
        one,
        shared.with_comments("\n".join(lines) + "\n"),
        (
            "y = M f + b; y_g = M_g C_gyro_i w + A C_gyro_i f + b_g (predicted readings)",
            "corrected: f = M^-1 (y - b); w = C_gyro_i^T M_g^-1 (y_g - b_g - A C_gyro_i f)",
        ),
        "Kalibr itself starts from M = I: this file is for programs that read its result",
    )


def _render_openvins(request: Request) -> Rendering:
    one = _triangular_model(request.model, "openvins")
    lines = [
        *_head_lines(request, "openvins", '"kalibr"'),
        *_yaml_matrix("Tw", one.gyro, "  "),
        *_yaml_matrix("R_IMUtoGYRO", one.gyro_turn, "  "),
        *_yaml_matrix("Ta", one.accelerometer, "  "),
        *_yaml_matrix("R_IMUtoACC", np.eye(3), "  ", 1),
        *_yaml_matrix("Tg", one.sensitivity, "  "),
    ]

    def write(header: Sequence[str]) -> str:
        return "%YAML:1.0\n" + shared.comments(header, "#") + "\n" + "\n".join(lines) + "\n"

    return _rendering(
        request,
        one,
        write,
        ("f = Ta^-1 (y - b); w = R_IMUtoGYRO^T Tw^-1 (y_g - b_g - Tg f)",),
        "to keep these numbers set calib_imu_intrinsics and calib_imu_g_sensitivity to false "
        "in estimator_config.yaml; biases are estimated while it runs",
    )


def _rendering(
    request: Request,
    one: _TriangularModel,
    write: Callable[[Sequence[str]], str],
    formula: tuple[str, ...],
    remark: str,
) -> Rendering:
    acc, gyro = (triad for _, triad in request.model.triads)
    return Rendering(
        one.correction(np.zeros(3), np.zeros(3)),
        write,
        formula,
        remarks=(frame_remark(one.turn), remark),
        correct_with_bias=one.correction(shared.written(acc.bias), shared.written(gyro.bias)),
    )


def frame_remark(turn: Array) -> str:
    """State the rotation Q, (3, 3), from the frame of the calibration to the frame of a file."""
    rows = "; ".join(", ".join(shared.number(x, 12) for x in row) for row in turn)
    return (
        f"frame of this file: f_file = Q f_calibration, w_file = Q w_calibration, with Q = [{rows}]"
    )


def _head_lines(request: Request, target: str, model: str) -> list[str]:
    """Return the first lines of the files for both programs."""
    noise = noise_values(request.options, target)
    return [
        "imu0:",
        *(f"  {name}: {shared.yaml_number(value)}" for name, value in noise.items()),
        f"  rostopic: {request.options['rostopic']}",
        "  time_offset: 0.0",
        f"  model: {model}",
        *_yaml_matrix("T_i_b", np.eye(4), "  ", 1),
    ]


def _yaml_matrix(name: str, matrix: Array, indent: str, digits: int = 12) -> list[str]:
    """Return a matrix as YAML, with one flow list per row."""
    rows = [f"{indent}- [{shared.yaml_row(row, digits)}]" for row in matrix]
    return [f"{indent}{name}:", *rows]


def stated_noise(options: Mapping[str, Any], names: Sequence[str], target: str) -> dict[str, float]:
    """Return the numbers of a noise model that options, or the file of the option noise, state.

    Raises
    ------
    InputError
        The file cannot be read, or a number is not above 0.
    """
    known: dict[str, float] = {}
    if options["noise"] is not None:
        path = Path(options["noise"])
        text = read_small_file(path, "file of noise", _LARGEST).decode("utf-8", "replace")
        for name in names:
            # Each line has one number, so PyYAML, which is an extra, is not needed.
            if found := re.search(rf"^\s*{name}\s*:\s*([-+.\deE]+)", text, re.MULTILINE):
                known[name] = _number(found[1], name, path)
    known |= {name: options[name] for name in names if options[name] is not None}
    wrong = [name for name, value in known.items() if not value > 0]
    if wrong:
        raise InputError(
            f"target {target}: {wrong[0]} is {known[wrong[0]]:g}; give a number above 0",
            key="--set",
            names=tuple(wrong),
        )
    return known


def noise_values(options: Mapping[str, Any], target: str) -> dict[str, float]:
    """Return the noise densities and the sampling rate that the user states, by Kalibr's keys.

    Parameters
    ----------
    options : mapping of str to object
        Values of `NOISE_OPTIONS`.
    target : str

    Raises
    ------
    InputError
        A value is missing or not above 0, or the file of noise cannot be read.
    """
    known = stated_noise(options, tuple(_KEYS), target)
    missing = [name for name in _KEYS if name not in known]
    if missing:
        raise InputError(
            f"target {target} needs the noise of the IMU, which a calibration does not contain: "
            + ", ".join(f"--set {name}=… ({_KEYS[name]})" for name in missing)
            + ", or --set noise=imu.yaml of a noise analysis",
            key="--set",
            names=tuple(missing),
        )
    return {name: known[name] for name in _KEYS}


def _number(text: str, name: str, path: Path) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{path}: {name}: {text} is not a number", file=path, key=name) from None


def _read(text: str, options: Mapping[str, Any]) -> StatedCalibration:
    printed = _printed_imus(text)
    content = printed or _yaml_content(text)
    name = options["imu"]
    one = _section(content, name)
    if one is None:
        raise InputError(
            f"there is no IMU {name!r}; give a result of Kalibr, or --set imu=… with another name",
            names=(name,),
        )
    force, rate = _section(one, "accelerometers"), _section(one, "gyroscopes")
    if force is None or rate is None:
        raise InputError(
            f"{name} uses the model {one.get('model')!r}, which has no intrinsics; calibrate with "
            "Kalibr's model scale-misalignment"
        )
    matrix, gyro = _matrix(force, "M"), _matrix(rate, "M")
    turn = _matrix(rate, "C_gyro_i")
    arms = [f"{arm} = {force[arm]} m" for arm in ("rx_i", "ry_i", "rz_i") if arm in force]
    return StatedCalibration(
        {
            "f": StatedTriad(matrix=matrix),
            "w": StatedTriad(matrix=gyro @ turn, sensitivity=_matrix(rate, "A") @ turn),
        },
        frame="triangular",
        notes=(
            "Kalibr states no biases",
            *(f"the size effect is left out: {', '.join(arms)}",) * bool(arms),
            *("read from a printed result, whose matrices are rounded",) * bool(printed),
        ),
    )


def _yaml_content(text: str) -> Any:
    with require_extra("kalibr", "files of Kalibr need PyYAML", ("yaml",)):
        yaml: Any = import_module("yaml")
    try:
        return yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise InputError(f"the YAML cannot be read: {error}") from None


def _printed_imus(text: str) -> dict[str, Any]:
    """Return the IMUs of a printed result, results-imucam.txt, in the structure of imu.yaml.

    Kalibr first prints the noise of each kind, and then the matrices of the gyroscope and of the
    accelerometer.
    """
    imus: dict[str, Any] = {}
    for number, body in _PRINTED_IMU.findall(text):
        gyro, _, acc = body.rpartition("Accelerometer:")
        found = {
            kind: {name: _printed_rows(rows) for name, rows in _PRINTED_MATRIX.findall(part)}
            for kind, part in (("gyroscopes", gyro), ("accelerometers", acc))
        }
        imus[f"imu{number}"] = {kind: one for kind, one in found.items() if one}
    return imus


def _printed_rows(text: str) -> list[Any]:
    """Return the rows of a printed matrix, or the numbers of a printed vector."""
    rows = [
        [float(x) for x in _PRINTED_NUMBER.findall(row)]
        for row in re.findall(r"\[([^\[\]]+)\]", text)
    ]
    return rows[0] if len(rows) == 1 else rows


def _section(content: Any, name: str) -> dict[str, Any] | None:
    """Return a nested mapping by name, or None if it does not exist."""
    found = cast("dict[str, Any]", content).get(name) if isinstance(content, dict) else None
    return cast("dict[str, Any]", found) if isinstance(found, dict) else None


def _matrix(content: Mapping[str, Any], name: str) -> Array:
    found = content.get(name)
    rows = cast("list[Any]", found) if isinstance(found, list) else []
    # This is checked before conversion to NumPy, because a small file with aliases can describe a
    # huge array.
    numbers = [
        float(x)
        for row in rows[:4]
        if isinstance(row, list)
        for x in cast("list[Any]", row)[:4]
        if isinstance(x, int | float)
    ]
    if len(rows) != 3 or len(numbers) != 9 or not np.isfinite(numbers).all():
        raise InputError(f"{name} must be a 3 × 3 matrix of finite numbers", names=(name,))
    return np.array(numbers).reshape(3, 3)


KALIBR = Target(
    "kalibr", "Kalibr imu.yaml, model scale-misalignment", ".yaml", _HOLDS, _render_kalibr, _OPTIONS
)
OPENVINS = Target(
    "openvins",
    "OpenVINS kalibr_imu_chain.yaml, model kalibr",
    ".yaml",
    _HOLDS,
    _render_openvins,
    _OPTIONS,
)
READER = CalibrationReader(
    "kalibr",
    "Kalibr imu.yaml or results-imucam.txt",
    _read,
    (TargetOption("imu", "which IMU of the file", "imu0", kind=str),),
)

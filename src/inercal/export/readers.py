"""Import calibrations made by other programs as a `Calibration` without covariance.

Such files state no uncertainties, so the covariance is zero, and a note in the calibration says so.
`inercal compare` therefore compares differences only with the U of the other calibration. Each
format is a module with `READER = CalibrationReader(...)`; other packages can register one with the
entry point `inercal.calibration_readers`.

The conversion from matrices and biases to coefficients is the inverse of `inercal.export.model`. An
axis with directions I, P, O reads f_I (1 + k1) + δ_O f_P − δ_P f_O + k0 (reference form). With row
r of the matrix this gives k1 = r·I − 1, δ_O = r·P and δ_P = −r·O. Gyros are treated in the same
way, and row r of A gives g_i = r·I, g_p = r·P and g_o = r·O.
"""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName
from inercal.basics.registry import Registry
from inercal.basics.small_files import read_small_file
from inercal.basics.units import si_factor
from inercal.calibration import Calibration
from inercal.export.model import parse_axes
from inercal.export.reader_definition import CalibrationReader, StatedCalibration, StatedTriad
from inercal.export.target_definition import resolve_options
from inercal.export.term_kinds import term_kind
from inercal.physics import frames
from inercal.physics.quantities import KINDS, QUANTITIES, Measures
from inercal.physics.sensors import TABLES, Axis, Readout, Sensor, axes_along

READERS: Registry[CalibrationReader] = Registry(
    "inercal.calibration_readers",
    "format",
    {
        name: f"inercal.export.targets.{place}"
        for name, place in {
            "imu_tk": "triads:IMU_TK_READER",
            "imucal": "triads:IMUCAL_READER",
            "kalibr": "kalibr:READER",
            "basalt": "camera_files:BASALT_READER",
            "realsense": "camera_files:REALSENSE_READER",
            "px4": "px4:READER",
            "ardupilot": "ardupilot:READER",
            "inav": "whole_counts:INAV_READER",
            "betaflight": "whole_counts:BETAFLIGHT_READER",
            "magcal": "magnetometers:MAGCAL_READER",
            "ros_magnetometer": "magnetometers:ROS_READER",
        }.items()
    },
)
_LARGEST = 4 << 20  # bytes; the parameters of a flight controller take about 100 kilobytes
WITHOUT_COVARIANCE = "imported without covariance, so its uncertainties are not known"
_LARGEST_SCALE_ERROR = 0.5
_WRITTEN_AXES = re.compile(r"frame: \w+ of the calibration with axes ([-xyz ]+);")  # header.py


def import_calibration(
    path: str | Path,
    of: str,
    *,
    like: Calibration | None = None,
    options: Mapping[str, Any] | None = None,
    name: str = "",
    axes: str | None = None,
) -> Calibration:
    """Import a calibration from a file made by another program.

    Parameters
    ----------
    path : path
    of : str
        Name of the format, one of `READERS`.
    like : Calibration, optional
        A calibration of the same sensor. Its axes, names and readouts are used, so the two
        calibrations can be compared. By default, the axes are ax, ay, az, gx, gy, gz with readings
        in SI.
    options : mapping of str to object, optional
        Options for the format, by name.
    name : str
        Name of the sensor; by default, the name in `like` or else the name of the file.
    axes : str, optional
        The file's x, y and z in terms of the body's axes, as in `export_calibration`. By default,
        the axes that inercal wrote in the explanation of the file, or else "x y z".

    Returns
    -------
    Calibration
        The calibration, with a covariance of zero.

    Raises
    ------
    InputError
        There is no such format, the file does not have this format, the sensor does not match, or
        the file states other axes.
    """
    reader = READERS.find(of)
    resolved = resolve_options(reader.name, reader.options, options or {})
    path = Path(path)
    raw = read_small_file(path, f"{reader.meaning} file", _LARGEST)
    try:
        text = raw.decode("utf-8-sig")
        stated = _for_sensor(reader.read(text, resolved), like)
        stated = _in_body_axes(stated, axes, _WRITTEN_AXES.search(text))
        named = name or (path.name.partition(".")[0] if like is None else like.sensor.name)
        calibration = _build_calibration(stated, like, named, of)
    except UnicodeDecodeError:
        raise InputError(
            f"{path} contains no text; give a {reader.meaning} file", file=path
        ) from None
    except InputError as error:
        raise error.located(path) from None
    provenance = {
        "imported file": path.name,
        "imported file sha256": hashlib.sha256(raw).hexdigest(),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "inercal": version("inercal"),
    }
    notes = (WITHOUT_COVARIANCE, *stated.notes)
    return replace(calibration, provenance=provenance, notes=notes)


def _in_body_axes(
    stated: StatedCalibration, axes: str | None, written: re.Match[str] | None
) -> StatedCalibration:
    """Return a file's statement in the axes of the body, the inverse of `export_model`.

    `axes` are those that the user states, and `written` those that an export stated in the file.
    """
    used = axes or (written[1] if written else "x y z")
    turn = parse_axes(used)
    if written and not np.array_equal(turn, parse_axes(written[1])):
        raise InputError(
            f"--axes {used!r}: the file itself states that its axes are {written[1]!r}; leave out "
            "--axes",
            key="--axes",
        )
    if np.array_equal(turn, np.eye(3)):
        return stated

    to_body, first = turn, stated.triads.get("f")
    if stated.frame == "triangular" and first is not None and first.matrix is not None:
        # This frame follows the order of the axes, so it is found again from the body's axes.
        to_body = turn @ frames.decompose_triangular(turn.T @ first.matrix @ turn)[1].T

    def back(one: StatedTriad) -> StatedTriad:
        def turned(matrix: Array | None) -> Array | None:
            return None if matrix is None else turn.T @ matrix @ to_body

        return StatedTriad(
            turned(one.matrix),
            None if one.scale is None else np.abs(turn.T) @ one.scale,
            None if one.bias is None else turn.T @ one.bias,
            one.bias_powers @ turn,
            turned(one.sensitivity),
        )

    return replace(
        stated,
        triads={kind: back(one) for kind, one in stated.triads.items()},
        notes=(*stated.notes, f"turned from the axes of the file, {used}, to those of the body"),
    )


def _for_sensor(stated: StatedCalibration, like: Calibration | None) -> StatedCalibration:
    """Return a file's statement without magnetometers if only these are not in the sensor.

    All parameters of an autopilot in one file then also suit a sensor without magnetometers.
    """
    others = {kind: one for kind, one in stated.triads.items() if kind != "m"}
    if "m" not in stated.triads or not others or like is None or like.sensor.rank("m"):
        return stated
    note = f"the magnetometers of the file are left out, because {like.sensor.name} has none"
    return replace(stated, triads=others, notes=(*stated.notes, note))


def _build_calibration(
    stated: StatedCalibration, like: Calibration | None, name: str, estimator: str
) -> Calibration:
    """Return a calibration with the values stated in a file and zero covariance.

    `like` provides axes and readouts, and `estimator` is the name of the format.
    """
    axes: list[Axis] = []
    values: dict[str, float] = {}
    for kind in KINDS:
        if (triad := stated.triads.get(kind)) is None:
            continue
        mine = _axes(stated, like, kind)
        axes += mine
        for row, axis in enumerate(mine):
            values |= _coefficients(triad, row, axis, kind, output=stated.output)
    sensor = Sensor(name, tuple(axes), reference_temperature=stated.reference_temperature)
    sensor = sensor.with_coefficients(*values)
    p = len(sensor.coefficients)
    _require_nominal(values, like)
    calibration = Calibration(
        sensor,
        np.array([values[full] for full in sensor.coefficients]),
        np.zeros((p, p)),
        "imported",
        estimator,
        frame=stated.frame,
    )
    return calibration.in_frame("triangular") if stated.own_frame else calibration


def _axes(stated: StatedCalibration, like: Calibration | None, kind: Measures) -> list[Axis]:
    if like is None:
        return _nominal_axes(stated, kind)
    found = [axis for axis in like.sensor.axes if axis.measures == kind]
    if len(found) != 3:
        raise InputError(
            f"the file states three {QUANTITIES[kind].sensors}, but {like.sensor.name} has "
            f"{len(found)}; give a calibration of the same sensor with --like",
            key="--like",
        )
    return found


def _nominal_axes(stated: StatedCalibration, kind: Measures) -> list[Axis]:
    """Return axes x, y and z, with readings in the unit that the file uses or in SI."""
    like = QUANTITIES[kind].ascii_unit
    unit = like if stated.units is None else stated.units[KINDS.index(kind)]
    try:
        readout = Readout(1 / si_factor(unit, like=like), 0.0, unit)
    except InputError:
        raise InputError(
            f"the {QUANTITIES[kind].sensors} read {unit!r}, which is not a unit: give a "
            "calibration of the same sensor with --like, which has its nominal readout",
            key="--like",
        ) from None
    return list(axes_along("xyz", kind, QUANTITIES[kind].letter, readout))


def _coefficients(
    triad: StatedTriad, row: int, axis: Axis, kind: Measures, *, output: bool
) -> dict[str, float]:
    """Return the coefficients of an axis, SI, by full name."""
    readout = axis.readout
    scale, offset = (readout.scale, readout.offset) if output else (1.0, 0.0)
    bias_name, scale_name = QUANTITIES[kind].bias, QUANTITIES[kind].scale
    found: dict[str, float] = {}
    along, pendulous, across = axis.frame
    if triad.matrix is not None:
        line = triad.matrix[row] / scale
        found[scale_name] = float(line @ along) - 1
        found["delta_o"] = float(line @ pendulous)
        found["delta_p"] = -float(line @ across)
    elif triad.scale is not None:
        found[scale_name] = float(triad.scale[row]) / scale - 1
    if triad.bias is not None:
        found[bias_name] = (float(triad.bias[row]) - offset) / scale
    if triad.sensitivity is not None:
        line = triad.sensitivity[row] / scale
        found |= {f"g_{k}": float(line @ v) for k, v in zip("ipo", axis.frame, strict=True)}
    for order, values in enumerate(triad.bias_powers, start=1):
        if np.any(triad.bias_powers[order - 1]):
            found[_temperature_name(kind, order)] = float(values[row])
    return {f"{axis.name}.{short}": value for short, value in found.items()}


def _require_nominal(values: dict[str, float], like: Calibration | None) -> None:
    far = [
        full
        for full, value in values.items()
        if CoefficientName(full).term in ("k1", "scale") and abs(value) > _LARGEST_SCALE_ERROR
    ]
    if far:
        what = (
            "of that sensor" if like is None else f"that fits: that of {like.sensor.name} does not"
        )
        raise InputError(
            f"the scale factor of {CoefficientName(far[0]).axis} is {1 + values[far[0]]:.3g} of "
            f"nominal; give a calibration with --like that has the nominal readout {what}",
            key="--like",
            names=tuple(far),
        )


def _temperature_name(kind: Measures, order: int) -> str:
    """Return the name of the term for a power of temperature."""
    for term in TABLES[kind]:
        if term_kind(kind, term) == "bias_temperature" and term.basis.degree("dT") == order:
            return term.name
    raise InputError(
        f"the bias of {QUANTITIES[kind].sensors} has a term of order {order} in temperature, "
        "but inercal has no coefficient for it"
    )

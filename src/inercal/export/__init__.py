"""Export of calibrations to other programs, devices and languages, and import from them.

`export_calibration` returns the text of a file and its error relative to the calibration; `TARGETS`
lists the targets. A target is a module with `TARGET = Target(...)`
(`inercal.export.target_definition`); another package can register one with the entry point
`inercal.exports`.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from inercal.basics.atomic_files import write_folder, write_text
from inercal.basics.errors import InputError
from inercal.basics.registry import Registry
from inercal.basics.units import format_quantity
from inercal.calibration import Calibration
from inercal.export.cost import Cost, Loss, costs, losses, possible_samples, sample
from inercal.export.header import feed_text, header_lines
from inercal.export.model import export_model
from inercal.export.ranges import Range, calibrated_ranges
from inercal.export.target_definition import Request, Target, resolve_options
from inercal.export.term_kinds import undetermined
from inercal.physics.quantities import KINDS, QUANTITIES, Measures

TARGETS: Registry[Target] = Registry(
    "inercal.exports",
    "target",
    {
        name: f"inercal.export.targets.{place}"
        for name, place in {
            "kalibr": "kalibr:KALIBR",
            "openvins": "kalibr:OPENVINS",
            "basalt": "camera_files:BASALT",
            "realsense": "camera_files:REALSENSE",
            "imu_calib": "triads:IMU_CALIB",
            "px4": "px4:TARGET",
            "ardupilot": "ardupilot:TARGET",
            "inav": "whole_counts:INAV",
            "betaflight": "whole_counts:BETAFLIGHT",
            "vectornav": "registers:VECTORNAV",
            "adis": "registers:ADIS",
            "imu_tk": "triads:IMU_TK",
            "imucal": "triads:IMUCAL",
            "c": "c_headers:C",
            "c_fixed": "c_headers:C_FIXED",
            "cpp": "c_headers:CPP",
            "matlab": "scripts:MATLAB",
            "python": "scripts:PYTHON",
            "ros2-node": "ros2:TARGET",
            "csv": "table:TARGET",
            "magcal": "magnetometers:MAGCAL",
            "ros_magnetometer": "magnetometers:ROS",
            "fusion": "magnetometers:FUSION",
        }.items()
    },
)


@dataclass(frozen=True)
class Export:
    """A calibration exported as the file of a target.

    Parameters
    ----------
    target : Target
    text : str
        The content of the file.
    costs : tuple of Cost
        Errors relative to the calibration over the calibrated range, for each kind of motion.
    losses : tuple of Loss
        Terms that the target cannot represent.
    header : tuple of str
        Lines of the explanation in the file.
    unmeasured : str
        Which components the sensor does not measure, and what to feed; "" if there are none.
    left_out : str
        Which axes the target has no place for, so that the file leaves them out; "" if none.
    undetermined : tuple of str
        Sentences on biases and scale factors that the target states, but the calibration does not.
    place : str
        Path of this file within the folder, if the target writes a folder; otherwise "".
    beside : mapping of str to str
        The contents of the other files of this folder, by path.
    """

    target: Target
    text: str
    costs: tuple[Cost, ...]
    losses: tuple[Loss, ...]
    header: tuple[str, ...]
    unmeasured: str
    left_out: str = ""
    undetermined: tuple[str, ...] = ()
    place: str = ""
    beside: Mapping[str, str] = field(default_factory=dict[str, str])

    def write(self, path: Path) -> None:
        """Write the file, or the folder if the target writes one, completely or not at all.

        Raises
        ------
        InputError
            The file or folder cannot be written.
        """
        if self.target.is_folder:
            write_folder(path, {self.place: self.text, **self.beside})
        else:
            write_text(path, self.text)


def export_calibration(
    calibration: Calibration,
    to: str,
    *,
    options: Mapping[str, Any] | None = None,
    axes: str = "x y z",
    lossless: bool = False,
    refit: bool = False,
    force: Range | None = None,
    rate: Range | None = None,
    temperature: Range | None = None,
    field: Range | None = None,
    source: str = "",
    name: str = "",
) -> Export:
    """Export a calibration as the file of a target, with its error relative to the calibration.

    Parameters
    ----------
    calibration : Calibration
    to : str
        Name of the target, one of `TARGETS`.
    options : mapping of str to object, optional
        Options for the target, by name.
    axes : str
        The target's x, y and z in terms of the body's axes: "x -y -z" converts front-left-up to
        front-right-down. The sensor's channels are rotated together with the axes.
    lossless : bool
        Whether to reject an export whose error exceeds U (k = 2) of the calibration, or whose error
        is unknown because a quantity is not measured or its range is not stated, or which leaves
        out sensors.
    refit : bool
        Whether scale factors, misalignments and biases are fitted over the range, for a target
        without nonlinear terms. Without `refit` the nonlinear terms are omitted.
    force, rate, temperature, field : (float, float), optional
        Ranges of each axis, m/s², rad/s, K and T; by default, the ranges of the calibration's data.
    source : str
        Name of the calibration file, for the explanation in the exported file.
    name : str
        Name used in generated code; by default, the sensor's name.

    Raises
    ------
    InputError
        There is no such target, an option is missing or invalid, the target cannot represent the
        sensor, or, with `lossless`, the error exceeds U or is unknown.
    """
    target = TARGETS.find(to)
    resolved = resolve_options(target.name, target.options, options or {})
    whole = calibration
    calibration, left_out = _for_target(whole, target)
    if lossless and left_out:
        raise InputError(f"--lossless: {left_out}; choose another target", key="--lossless")
    ranges = calibrated_ranges(
        calibration, force=force, rate=rate, temperature=temperature, field=field
    )
    model = export_model(calibration, axes)
    samples = sample(model, ranges)
    if refit:
        if any("polynomial" in held for held in target.holds.values()):
            raise InputError(
                f"--refit: target {to} includes nonlinear terms, so a refit is not needed; "
                "remove --refit",
                key="--refit",
            )
        readings = model.sensor.forward(samples.motion, model.calibration.values)
        model = export_model(calibration, axes, refit=(samples.motion, readings))
    named = identifier(name or calibration.sensor.name)
    request = Request(model, ranges, resolved, named, samples.readings[-1:], samples.dT[-1:])
    rendering = target.render(request)
    if rendering.possible is not None:
        samples = possible_samples(model, samples, rendering.possible)
    holds = target.holds if rendering.holds is None else rendering.holds
    missing = undetermined(calibration.sensor, holds)
    texts = tuple(missing.values())
    lost = losses(model, samples, target, rendering)
    unknown = {measures for measures, kind in missing if kind == "bias"}
    cost = tuple(
        replace(one, expanded=nan) if one.measures in unknown else one
        for one in costs(model, samples, rendering.correct)
    )
    if lossless and unknown:
        raise InputError(f"--lossless: {texts[0]}; calibrate it first", key="--lossless")
    if lossless and (any(one.exceeds for one in cost) or any(one.unknown for one in lost)):
        raise InputError(_refusal(target, cost, lost), key="--lossless")
    biased = rendering.correct_with_bias
    header = header_lines(
        model,
        target,
        rendering,
        samples,
        ranges,
        cost,
        lost,
        with_bias=() if biased is None else costs(model, samples, biased),
        source=Path(source).name,
        refitted=refit,
        left_out=left_out,
        undetermined=texts,
        whole=whole if left_out else None,
    )
    text, unmeasured = rendering.write(header), feed_text(model, rendering)
    return Export(
        target,
        text,
        cost,
        lost,
        header,
        unmeasured,
        left_out,
        texts,
        rendering.place,
        rendering.beside,
    )


def _for_target(calibration: Calibration, target: Target) -> tuple[Calibration, str]:
    """Return the part of a calibration that a target has a place for, and say what is left out.

    Accelerometers and gyros are only left out by targets for magnetometers. Other targets return
    the readings of an accelerometer or a gyro unchanged if they cannot correct it.
    """
    sensor = calibration.sensor
    kinds = {axis.measures for axis in sensor.axes}
    left = ({"f", "w"} if set(target.holds) == {"m"} else {"m"}).difference(target.holds)
    kept: list[Measures] = [kind for kind in KINDS if kind in kinds and kind not in left]
    if len(kept) == len(kinds):
        return calibration, ""
    if not kept:
        fitting = " and ".join(QUANTITIES[kind].sensors for kind in target.holds)
        raise InputError(
            f"target {target.name} is for {fitting}, but sensor {sensor.name} has none; choose "
            "another target",
            key="--to",
            names=sensor.channels,
        )
    part = sensor.select_axes(*kept)
    rows = [sensor.coefficients.index(name) for name in part.coefficients]
    without = ", ".join(axis.name for axis in sensor.axes if axis.measures not in kept)
    reduced = replace(
        calibration,
        sensor=part,
        values=calibration.values[rows],
        covariance=calibration.covariance[np.ix_(rows, rows)],
        shared=None,
        conformity=None,
    )
    return reduced, f"target {target.name} has no place for {without}"


def identifier(text: str) -> str:
    """Convert a text to a name for code, with only lower-case letters, digits and underscores.

    >>> identifier("IMU-7 (left)")
    'imu_7_left'
    """
    plain = re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_").lower()
    return plain if plain[:1].isalpha() else f"imu_{plain}".rstrip("_")


def _refusal(target: Target, cost: tuple[Cost, ...], lost: tuple[Loss, ...]) -> str:
    worst = "; ".join(
        ", with a U at that point of ".join(
            format_quantity(size, 0.0, QUANTITIES[one.measures].bias_unit, 3)
            for size in (one.largest, one.expanded)
        )
        for one in cost
        if one.exceeds
    )
    what = ", ".join(dict.fromkeys(one.word for one in lost)) or "digits of its numbers"
    unknown = " and ".join(dict.fromkeys(one.unknown for one in lost if one.unknown))
    error = (
        f"the error over the calibrated range is at most {worst}"
        if worst
        else f"the error is unknown, because {unknown}"
    )
    return (
        f"--lossless: {target.name} cannot represent {what}; {error}. Choose another target, "
        "or remove --lossless"
    )


__all__ = ["TARGETS", "Cost", "Export", "Loss", "export_calibration", "identifier"]

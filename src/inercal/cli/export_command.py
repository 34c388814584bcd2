"""`inercal export`: write a calibration in the format of another program or device."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from inercal.basics.errors import InputError, error_location
from inercal.basics.units import format_number, format_quantity, si_factor, to_si
from inercal.cli.console import print_json, report_line
from inercal.cli.options import Force, Json, assignments, flag, optional, out_option, repeated
from inercal.cli.outputs import OutputKind, check_output_folder, check_outputs, source_files
from inercal.physics.quantities import QUANTITIES

if TYPE_CHECKING:
    from inercal.export import Export
    from inercal.export.ranges import Range
    from inercal.export.target_definition import Target


OPTION_FORM = "OPTION=VALUE"
_LEAST = 1e-3  # of the unit of the largest error; smaller ones do not count
SET = repeated(
    "An option of the target, such as --set acc_id=1310988.", "--set", metavar="OPTION=VALUE"
)
AXES = typer.Option(
    "x y z",
    "--axes",
    help="Body axes of the target's x, y, z: 'x -y -z' turns front-left-up into front-right-down.",
)
LOSSLESS = flag(
    "--lossless", "Refuse the export if its error is unknown or exceeds the calibration's U."
)
REFIT = flag(
    "--refit", "Fit linear terms over the range, for a target that has no nonlinear terms."
)
FORCE_RANGE = optional(
    "Range of each accelerometer, such as '-2 2 g' (default: that of the data).", "--over-force"
)
RATE_RANGE = optional("Range of each gyro, such as '-200 200 deg/s'.", "--over-rate")
FIELD_RANGE = optional("Range of each magnetometer, such as '-60 60 µT'.", "--over-field")
TEMPERATURE_RANGE = optional("Temperature range, such as '-10 60 °C'.", "--over-temperature")


def run(
    calibration_file: Path = typer.Argument(help="A *.calibration.json file."),
    to: str = typer.Option(
        ...,
        help="Target: kalibr, openvins, basalt, realsense, imu_calib, px4, ardupilot, inav, "
        "betaflight, vectornav, adis, imu_tk, imucal, c, c_fixed, cpp, matlab, python, ros2-node, "
        "csv, magcal, ros_magnetometer, fusion, or a target from another package.",
    ),
    out: Path | None = out_option(
        "The file or folder to write (default: RUN.TARGET.SUFFIX or NAME_correct)."
    ),
    stated: list[str] = SET,
    axes: str = AXES,
    lossless: bool = LOSSLESS,
    refit: bool = REFIT,
    over_force: str | None = FORCE_RANGE,
    over_rate: str | None = RATE_RANGE,
    over_temperature: str | None = TEMPERATURE_RANGE,
    over_field: str | None = FIELD_RANGE,
    name: str | None = optional(
        "Name in the code and of the file (default: names of the sensor and the run)."
    ),
    force: Force = False,
    json: Json = False,
) -> None:
    """Write a calibration for another program or device, and print the error of the export."""
    from inercal.calibration.delays import uncorrected_delays
    from inercal.calibration.files import load
    from inercal.export import TARGETS, export_calibration, identifier

    target = TARGETS.find(to)
    calibration = load(calibration_file)
    path = out or default_path(calibration_file, target, calibration.sensor.name, name or "")
    inputs = source_files(path, calibration_file, calibration.provenance)
    if not target.is_folder:
        check_outputs({path: OutputKind("export")}, inputs, force=force)
    made = export_calibration(
        calibration,
        to,
        options=assignments(stated, "--set", OPTION_FORM),
        axes=axes,
        lossless=lossless,
        refit=refit,
        force=parse_range(over_force, "m/s^2", "--over-force"),
        rate=parse_range(over_rate, "rad/s", "--over-rate"),
        temperature=parse_range(over_temperature, "K", "--over-temperature"),
        field=parse_range(over_field, "T", "--over-field"),
        source=str(calibration_file),
        name=name or "",
    )
    if target.is_folder:
        check_output_folder(path, (made.place, *made.beside), inputs, force=force)
    made.write(path)
    if (verdict := calibration.verdict) is not None and verdict.grade == "unreliable":
        report_line(f"warning: {calibration_file} is {verdict.word}")
    if json:
        print_json({"file": str(path), "target": to, **costs_object(made)})
        return
    plain = identifier(name) if name else name
    renamed = "" if plain == name else f"the name {name!r} is written as {plain}"
    left_out = f"not in this file: {made.left_out}" if made.left_out else ""
    late = uncorrected_delays(calibration.conditions)
    for line in filter(
        None, (renamed, left_out, *late, made.unmeasured, *made.undetermined, *cost_lines(made))
    ):
        print(line)
    print(f"wrote {path}")


def default_path(calibration_file: Path, target: "Target", sensor: str, name: str = "") -> Path:
    """Return the output file for an export: RUN.TARGET.SUFFIX, or NAME_correct for source code.

    Parameters
    ----------
    calibration_file : Path
    target : Target
    sensor : str
        Name of the sensor, used for function names if `name` is empty.
    name : str
        Name for functions and files.
    """
    from inercal.export import identifier

    if target.named_by_function:
        return Path(f"{identifier(name or sensor)}_correct{target.suffix}")
    stem = calibration_file.name.removesuffix(".json").removesuffix(".calibration")
    return Path(f"{identifier(name) if name else stem}{target.file_suffix}")


def parse_range(text: str | None, unit: str, option: str) -> "Range | None":
    """Convert a range such as "-2 2 g" to SI units.

    Raises
    ------
    InputError
        The text is not two numbers and a unit of the required dimension.
    """
    if text is None:
        return None
    import numpy as np

    parts = text.split(maxsplit=2)
    try:
        numbers = np.array([float(part) for part in parts[:2]])
        if len(parts) < 3 or not np.isfinite(numbers).all():
            raise ValueError
    except ValueError:
        raise InputError(
            f"{option} {text!r}: give the lower limit, the upper limit and the unit, such as "
            f"'-10 10 {unit}'",
            key=option,
        ) from None
    with error_location(f"{option} {text!r}", key=option):
        low, high = to_si(numbers, parts[2], unit).tolist()
    if not low < high:
        raise InputError(f"{option} {text!r}: give the lower limit first", key=option)
    return low, high


def costs_object(made: "Export") -> dict[str, Any]:
    """Return the accuracy lost by an export for JSON, in SI units."""
    return {
        "unmeasured": made.unmeasured,
        "left_out": made.left_out,
        "undetermined": made.undetermined,
        "errors": {
            one.measures: {
                "max": one.largest,
                "rms": one.rms,
                "U": one.expanded,
                "exceeds_U": one.exceeds,
            }
            for one in made.costs
        },
        "not_held": [
            {"of": one.measures, "what": one.word, "names": list(one.names), "effect": one.effect}
            for one in made.losses
        ],
    }


def cost_lines(made: "Export") -> list[str]:
    """Describe the accuracy lost by an export, line by line."""
    # All sizes of a quantity are in the unit of the largest.
    sizes = {kind: si_factor(one.bias_unit) for kind, one in QUANTITIES.items()}
    for one in made.costs:
        sizes[one.measures] = max(sizes[one.measures], one.largest, one.expanded)  # NaN is ignored
    for one in made.losses:
        sizes[one.measures] = max(sizes[one.measures], one.effect)  # NaN if it is unknown
    units = {
        kind: format_quantity(size, 0.0, QUANTITIES[kind].bias_unit, 2).partition(" ")[2]
        for kind, size in sizes.items()
    }
    lines = [
        f"not included by {made.target.name}: {one.word} ({QUANTITIES[one.measures].name}), "
        + one.effect_text(_size_text(one.effect, units[one.measures]))
        for one in made.losses
    ]
    for one in made.costs:
        largest, rms, there = (
            _size_text(size, units[one.measures]) for size in (one.largest, one.rms, one.expanded)
        )
        lines.append(
            f"error in {QUANTITIES[one.measures].name} over the range: maximum {largest}, rms {rms}"
            + (f", U at the point of the maximum {there}" if one.expanded > 0 else "")
            + (f" (exceeds U{' elsewhere' * (one.largest <= one.expanded)})" if one.exceeds else "")
        )
    return lines


def _size_text(size: float, unit: str) -> str:
    shown = size / si_factor(unit)
    return f"{f'less than {_LEAST:g}' if shown < _LEAST else format_number(shown, 2)} {unit}"

"""`inercal noise`: find the noise of a sensor from a recording at rest."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from inercal.basics.atomic_files import write_text
from inercal.basics.errors import InputError
from inercal.cli import console
from inercal.cli.log_drafts import stated_keys
from inercal.cli.noise_outputs import NoiseFiles
from inercal.cli.options import Force, Json, flag, optional, repeated
from inercal.cli.outputs import PAGE, check_outputs

if TYPE_CHECKING:
    from inercal.noise.data_sheet import DataSheetNoise
    from inercal.recordings import Recording


def run(
    recording: Path | None = typer.Argument(
        None, help="A recording at rest, or the run file (.toml) whose \\[data] names it."
    ),
    datasheet: Path | None = optional(
        "A file (.toml) with the noise that a data sheet states. It is compared with the "
        "recording, or imported if there is no recording.",
        metavar="FILE",
    ),
    stated: list[str] = repeated(
        "Values that you know: --set data.gyro=gx,gy,gz, --set sensor.gyro.unit=°/s, "
        '--set "data.rate=100 Hz".',
        "--set",
        metavar="KEY=VALUE",
    ),
    terms: str | None = optional(
        "Terms to fit, such as NBK, instead of those that the data justify."
    ),
    method: str = typer.Option(
        "likelihood", help="Estimator for the reported values: likelihood, gmwm or wls_log."
    ),
    spacing: str = typer.Option("octave", "--taus", help="Averaging times: octave, decade or all."),
    skip_disturbed: bool = flag("--skip-disturbed", "Exclude disturbed periods from the fit."),
    skip_band: list[str] = repeated(
        "Exclude a frequency band in Hz from the fit, such as that of a vibration: 3.5-5.5.",
        metavar="LOW-HIGH",
    ),
    report: bool = flag("--report", "Write a page with the plots."),
    run_files: list[Path] = repeated(
        "Write the noise to \\[sensor.*] in this run file; an existing file needs --force.",
        "--write",
        metavar="RUN_FILE",
    ),
    to: list[str] = repeated(
        "Write the noise for another program, or as the Q of a filter.",
        metavar="kalibr|vins_fusion|fast_lio|ros|filter",
    ),
    horizon: float = typer.Option(
        100.0,
        help="Time in s at which a random walk equals a bias instability, for a program that "
        "supports only random walks.",
    ),
    register: str | None = optional(
        "Enter the analysis in this register: a path, sqlite:///PATH or "
        "postgresql://USER@HOST/DATABASE; by default $INERCAL_REGISTER."
    ),
    sensor: str | None = optional(
        "Name of the sensor in the register; by default that in the run file."
    ),
    measured: str | None = optional("Date of the recording, such as 2026-03-01; by default now."),
    by: str | None = optional(
        "Name of the person who enters the analysis; by default your user name."
    ),
    out: Path = typer.Option(Path(), "--out", "-o", help="Folder for the files to write."),
    force: Force = False,
    json: Json = False,
) -> None:
    """Find the noise, bias instability, random walk and disturbances of a sensor at rest."""
    from inercal.cli.noise_view import print_analysis, print_comparison_with_sheet, sheet_object

    _check_choices(method, spacing, to, horizon)
    if len(run_files) > 1:
        raise InputError(
            f"--write is given {len(run_files)} times ({', '.join(map(str, run_files))}): give one "
            "run file, and repeat the command for another",
            key="--write",
        )
    section = run_files[0] if run_files else None
    bands = [_band(one) for one in skip_band]
    if recording is None:
        of_recording = {
            "--set": stated, "--terms": terms, "--method": method != "likelihood",
            "--taus": spacing != "octave", "--skip-disturbed": skip_disturbed,
            "--skip-band": skip_band, "--report": report, "--register": register,
            "--sensor": sensor, "--measured": measured, "--by": by,
        }  # fmt: skip
        _import_data_sheet(
            datasheet, of_recording, NoiseFiles(to, horizon, section, out, force), json=json
        )
        return
    name = _sensor_name(recording, sensor, measured, by, register)
    sheet = None if datasheet is None else _read_data_sheet(datasheet)
    pages = {"page": out / f"{recording.stem}.noise.html"} if report else {}
    inputs = [recording] if datasheet is None else [recording, datasheet]
    check_outputs(dict.fromkeys(pages.values(), PAGE), inputs, force=force or None)
    targets = NoiseFiles(to, horizon, section, out, force)
    targets.check(recording.stem, inputs)
    if report:
        from inercal.report import require_report_packages

        require_report_packages()
    known, long = stated_keys(stated), None
    if recording.suffix.lower() != ".toml":
        from inercal.pipeline.drafts.long_rest_recording import open_long_rest_recording

        long = open_long_rest_recording(recording, known)
    if long is not None:
        _require_possible_in_blocks(recording, method, spacing, skip_disturbed=skip_disturbed)
        with console.progress_status(f"reading {recording} in blocks"):
            stream = long.stream()
        with console.progress_status(f"analysing {recording}"):
            from inercal.noise.analysis import candidate_models

            readings = stream.block_mean_recording()
            moved = _require_rest(readings, section, to, register)
            analysis = stream.analysis(candidate_models(terms), bands, long.table.sha256())
            analysis = replace(analysis, movement=moved)
    else:
        with console.progress_status(f"reading {recording}"):
            readings = _read(recording, known)
            _require_rest(readings, section, to, register)
        with console.progress_status(f"analysing {recording}"):
            from inercal.noise import analyse_noise

            analysis = analyse_noise(
                readings,
                terms=terms,
                method=method,  # type: ignore[arg-type]
                spacing=spacing,  # type: ignore[arg-type]
                keep_disturbed=not skip_disturbed,
                skipped_bands=bands,
                gravity=_gravity(recording),
            )
    from inercal.noise.data_sheet import compare_with_sheet
    from inercal.noise.sensor_noise import require_stated, sensor_noise

    if register is not None:
        require_stated(analysis)
    compared = () if sheet is None else compare_with_sheet(analysis, sheet)
    files = targets.write(recording.stem, sensor_noise(analysis)) if targets.are_wanted else {}
    for kind, path in pages.items():
        from inercal.report.noise_page import noise_page

        files[kind] = write_text(path, noise_page(analysis, readings, sheet))
    entered: dict[str, str | int] = {}
    if register is not None:
        with console.open_register(register, by) as opened:
            number = opened.enter_noise(analysis, name, measured)
            entered = {"register": opened.address, "sensor": name, "number": number}
    if json:
        from inercal.noise.texts import analysis_object

        content = analysis_object(analysis) | {key: str(path) for key, path in files.items()}
        if sheet is not None:
            content["data_sheet"] = sheet_object(sheet, compared)
        console.print_json(content | ({"entered": entered} if entered else {}))
    else:
        print_analysis(analysis)
        if sheet is not None:
            print_comparison_with_sheet(compared, sheet)
        console.print_written_files(files.values())
        if entered:
            print(
                f"{entered['register']}: noise analysis {entered['number']} of {entered['sensor']}"
            )
    console.exit_if(analysis.movement or any(one.disturbed for one in analysis.channels))


def _require_rest(
    readings: "Recording", section: Path | None, to: Sequence[str], register: str | None
) -> str:
    """Describe how the sensor moved, and raise an error if its noise would be stored."""
    from inercal.noise.recording_checks import movement
    from inercal.noise.texts import movement_text

    moved = movement(readings)
    stores = {"--write": section, "--to": to, "--register": register}
    if moved and (asked := [option for option, value in stores.items() if value]):
        raise InputError(
            f"{movement_text(moved, readings.source)}; {' and '.join(asked)} would "
            "store this noise",
            file=readings.source or None,
            key=asked[0],
        )
    return moved


def _check_choices(method: str, spacing: str, to: Sequence[str], horizon: float) -> None:
    """Raise an error for an unknown method, spacing or program before the work begins."""
    from inercal.noise.coefficients import METHODS
    from inercal.noise.deviations import SPACINGS
    from inercal.noise.noise_files import WRITERS

    for option, value, possible in (
        ("--method", method, METHODS),
        ("--taus", spacing, SPACINGS),
        *(("--to", one, tuple(WRITERS)) for one in to),
    ):
        if value not in possible:
            raise InputError(f"{option} {value!r}: it can be {', '.join(possible)}", key=option)
    if not 0 < horizon < float("inf"):
        raise InputError(f"--horizon {horizon:g}: give a positive time in s", key="--horizon")


def _sensor_name(
    recording: Path, sensor: str | None, measured: str | None, by: str | None, register: str | None
) -> str:
    """Return the sensor's name in the register, or an empty text without a register."""
    if register is None:
        for option, value in (("--sensor", sensor), ("--measured", measured), ("--by", by)):
            if value is not None:
                raise InputError(f"{option} works only with --register; add it", key=option)
        return ""
    if sensor is None and recording.suffix.lower() == ".toml":
        from inercal.runfile import read

        sensor = read(recording).sensor.name
    if not (sensor or "").strip():
        raise InputError(
            "--register needs the sensor's name in the register: add --sensor NAME", key="--sensor"
        )
    if measured is not None:
        from inercal.basics.documents import stated_time

        stated_time(measured, "--measured ")
    return str(sensor)


def _band(text: str) -> tuple[float, float]:
    """Return the lowest and the highest frequency of "LOW-HIGH", Hz."""
    try:
        low, high = (float(one) for one in text.replace("–", "-").split("-"))
    except ValueError:
        low = high = float("nan")
    if not 0 <= low < high < float("inf"):
        raise InputError(
            f"--skip-band {text!r}: write the lowest and the highest frequency in Hz, such as "
            "3.5-5.5",
            key="--skip-band",
        )
    return low, high


def _require_possible_in_blocks(
    path: Path, method: str, spacing: str, *, skip_disturbed: bool
) -> None:
    """Raise an error for options that need all samples in memory."""
    for option, asked in (
        ("--skip-disturbed", skip_disturbed),
        (f"--taus {spacing}", spacing != "octave"),
        (f"--method {method}", method != "likelihood"),
    ):
        if asked:
            raise InputError(
                f"{option}: {path} is too long for the memory, so it is analysed in blocks, at "
                "octaves, by likelihood and including disturbed times; omit the option, or "
                "give a part of the recording",
                key=option.split()[0],
            )


def _read(path: Path, known: dict[str, str]) -> "Recording":
    """Return the readings from a run file's recording or from a log, in SI units."""
    from inercal.physics.quantities import QUANTITIES
    from inercal.pipeline.drafts.rest_recording import in_si, read_rest_recording, repeats_values

    if path.suffix.lower() != ".toml":
        return read_rest_recording(path, known)
    if known:
        raise InputError(
            f"--set: {path} is a run file, which states these keys; change them there", key="--set"
        )
    from inercal.recordings.data.recording_loader import load_recording
    from inercal.runfile import read

    run = read(path)
    if run.data.kind == "means":
        raise InputError(
            "[data] contains means, which have no sample noise; give a recording", key="[data] kind"
        ).located(path)
    recording = load_recording(run.with_all_axes)
    if run.magnetometer is not None:
        field = [recording.channels.index(name) for name in run.magnetometer.channels]
        if repeats_values(recording.data[:, field]):
            recording = load_recording(run)
    axes = {axis.name: axis for axis in run.whole_sensor.axes}
    chosen = [axes[name] for name in recording.channels]
    units = [QUANTITIES[axis.measures].unit for axis in chosen]
    return in_si(recording, [axis.readout for axis in chosen], units)


def _gravity(path: Path) -> float | None:
    """Return gravity at the bench, m/s², or None if the bench rotates the sensor."""
    from inercal.physics.sensors import G0

    if path.suffix.lower() != ".toml":
        return G0
    from inercal.runfile import read

    run = read(path)
    return None if run.kind.spins else float(run.bench.gravity.value)


def _read_data_sheet(path: Path) -> "DataSheetNoise":
    from inercal.runfile.noise_data_sheet import read_noise_data_sheet

    return read_noise_data_sheet(path)


def _import_data_sheet(
    path: Path | None, of_recording: Mapping[str, object], targets: NoiseFiles, *, json: bool
) -> None:
    """Print the noise stated in a data sheet, and write the output files."""
    if path is None:
        raise InputError(
            "give a recording at rest or its run file, or --datasheet FILE to import noise from "
            "a data sheet",
            key="RECORDING",
        )
    for option, value in of_recording.items():
        if value:
            raise InputError(
                f"{option} needs a recording, but only a data sheet is given: add a recording, or "
                "omit the option",
                key=option,
            )
    from inercal.cli.noise_view import print_sheet, sheet_object

    sheet = _read_data_sheet(path)
    targets.check(path.stem, [path])
    files = targets.write(path.stem, sheet.sensor_noise)
    if json:
        written = {kind: str(one) for kind, one in files.items()}
        console.print_json({"data_sheet": sheet_object(sheet)} | written)
        return
    print_sheet(sheet)
    console.print_written_files(files.values())

"""`inercal simulate`: simulate the recording for a run file's plan."""

from pathlib import Path

import typer

from inercal.basics.units import format_duration
from inercal.cli.console import print_json, progress_status
from inercal.cli.options import Force, Json, out_option
from inercal.cli.outputs import RECORDING, check_outputs


def run(
    run_file: Path = typer.Argument(
        help="The run file (TOML); \\[sensor.truth] contains the true values."
    ),
    out: Path | None = out_option(
        "The recording to write (.csv, .npz, .parquet); by default \\[data] file."
    ),
    seed: int = typer.Option(0, min=0, help="Seed for the noise and for the errors of the bench."),
    force: Force = False,
    json: Json = False,
) -> None:
    """Simulate the plan of a run file, and write the recording."""
    from inercal.runfile import read

    plan = read(run_file)
    # The modules of the work load after the run file was checked.
    from inercal.pipeline import simulate_files
    from inercal.recordings.io.write import write_recordings

    names = [plan.data.file, *plan.data.further_files().values()]
    paths = [plan.file(name) for name in names]
    if out is not None:
        paths = [out, *(out.parent / path.name for path in paths[1:])]
    recordings = {plan.file(name) for name in names}
    inputs = [path for path in plan.input_files() if path not in recordings]
    check_outputs(dict.fromkeys(paths, RECORDING), inputs, force=force)
    written = " and ".join(map(str, paths))
    with progress_status(f"simulating {written}"):
        result = simulate_files(plan, seed)
        write_recordings(dict(zip(paths, result.values(), strict=True)))
    assert plan.rate_hz is not None  # needed for any simulation
    samples = result[plan.data.file].time.size
    seconds = (samples - 1) / plan.rate_hz
    if json:
        print_json(
            {
                **dict(zip(("recording", "readback"), map(str, paths), strict=False)),
                "samples": samples,
                "seconds": seconds,
                "seed": seed,
                "truth": dict(plan.truth),
            }
        )
    else:
        print(f"wrote {written}: {samples} samples, {format_duration(seconds)}")

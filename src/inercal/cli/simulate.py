"""`inercal simulate`: the run's plan on its simulated bench, written as a recording."""

from pathlib import Path

import typer

NAME = "simulate"


def run(
    run_file: Path = typer.Argument(help="The run file (TOML); \\[sensor.truth] is the truth."),
    out: Path | None = typer.Option(
        None, "--out", "-o", help="The recording to write (.csv, .npz, .parquet); \\[data] file."
    ),
    seed: int = typer.Option(0, help="Seed of the noise and of the bench's errors."),
    force: bool = typer.Option(False, "--force", help="Write over an existing recording."),
    json: bool = typer.Option(False, "--json", help="Print one JSON object."),
) -> None:
    """Simulate the recording that the run's plan would leave."""
    from inercal.cli.show import as_json, working
    from inercal.errors import InputError
    from inercal.io.write import write_recording
    from inercal.pipeline import named_as_in, simulate
    from inercal.runfile import read

    plan = read(run_file)
    path = out or plan.file(plan.data.file)
    if path.exists() and not force:
        raise InputError(f"{path} exists: name another with --out, or write over it with --force")
    with working(f"simulating {path}"):
        recording = simulate(plan, seed)
        write_recording(named_as_in(plan, recording), path)
    if json:
        as_json(
            {
                "recording": str(path),
                "samples": int(recording.time.size),
                "seconds": recording.duration,
                "seed": seed,
                "truth": dict(plan.truth),
            }
        )
    else:
        print(f"wrote {path}: {recording.time.size} samples, {recording.duration:.1f} s")

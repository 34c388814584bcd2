"""Compile all kernels in advance, so that later runs need not wait for the compiler.

Numba compiles a kernel when it is first called with arguments of certain types. The kernels are
therefore compiled by running short simulations that use them: a run on a simulated turntable, the
other turntable methods on its recording, navigation between rests, a hand-held IMU, and batches of
centrifuge and six-position fits.
"""

from collections.abc import Callable, Iterator
from functools import partial
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from inercal.basics.errors import InercalError
from inercal.host.demonstration import RUN_FILE, demo
from inercal.host.packets.checksums import CHECKS
from inercal.noise import deviations
from inercal.physics.plan import six_positions
from inercal.pipeline import calibrate, simulate_files
from inercal.pipeline.batch import calibrate_batch
from inercal.pipeline.budget import budget
from inercal.pipeline.budget.experiment_from_runfile import experiment_from_run
from inercal.recordings.io.write import write_recordings
from inercal.recordings.segments import scatter
from inercal.runfile import read

_OTHER_METHODS = ("turntable_trajectory", "turntable_discrete")
_BATCH = 16  # trials; enough that they are solved as a batch
_RATES = '["60 rpm", "120 rpm", "180 rpm"]'  # as arm.toml states them
_RUN_FILES = files("inercal.cli") / "compiled_runs"


def compile_kernels(progress: Callable[[str], None]) -> tuple[str, ...]:
    """Run each simulation once, so that Numba stores the kernels in its cache.

    Parameters
    ----------
    progress : callable
        Function that is called with a description of each simulation before it begins.

    Returns
    -------
    tuple of str
        One line for each simulation that cannot run here, for example because an optional library
        is missing. Its kernels are compiled when they are first used.
    """
    failed: list[str] = []
    with TemporaryDirectory() as folder:
        for what, work in _work(Path(folder)):
            progress(what)
            try:
                work()
            except InercalError as error:
                failed.append(f"{what}: {error}")
    return tuple(failed)


def _work(folder: Path) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield each simulation with its description; the second uses the files from the first."""
    driven = folder / "driven"
    yield "a run on a simulated turntable", partial(demo, driven, quick=True)
    for name in _OTHER_METHODS:
        yield (
            f"the recording from a turntable, with {name}",
            partial(_follow_recording, driven, name),
        )
    yield "an IMU with navigation between rests", partial(_calibrate_by_navigation, folder)
    yield "a hand-held IMU", partial(_calibrate_by_hand, folder)
    yield "batches of fits", partial(_fit_batches, folder)
    yield "packet checksums", _check_packets
    yield "the noise of a sensor", _find_noise


def _follow_recording(driven: Path, name: str) -> None:
    """Calibrate with another method from the recording that a run left in its folder."""
    text = (driven / RUN_FILE).read_text(encoding="utf-8").replace("turntable_kalman", name)
    other = driven / f"{name}.toml"
    other.write_text(text, encoding="utf-8")
    calibrate(other)


def _calibrate_by_navigation(folder: Path) -> None:
    """Simulate and calibrate an IMU on a table whose angles are not used.

    All estimators are run in turn, because the live estimator has its own kernel.
    """
    path = folder / "navigation.toml"
    path.write_bytes((_RUN_FILES / path.name).read_bytes())
    run = read(path)
    made = simulate_files(run, 0)
    write_recordings({run.file(name): one for name, one in made.items()})
    for estimator in run.method.estimators:
        calibrate(read(path, {"estimator": estimator}))


def _calibrate_by_hand(folder: Path) -> None:
    """Simulate an IMU that is turned by hand, and calibrate it including the gyro delay."""
    text = files("inercal").joinpath("hand_held.toml").read_text(encoding="utf-8")
    path = folder / "hand_held.toml"
    path.write_text(
        f'{text}\nalso = ["g"]\npositions = 24\nseconds = "3 s"\ntime_offset = true\n',
        encoding="utf-8",
    )
    run = read(path)
    made = simulate_files(run, 0)
    write_recordings({run.file(name): one for name, one in made.items()})
    outcome = calibrate(run)
    assert outcome.recording is not None
    scatter(outcome.recording, run.sensor, "f")  # shown in a report


def _fit_batches(folder: Path) -> None:
    """Run batches of fits by norm and by vector, with Jacobians computed for all trials."""
    path = folder / "arm.toml"
    arm = (_RUN_FILES / path.name).read_text(encoding="utf-8")
    by_vectors = arm.replace("[data]", 'indexing = "5 ″"\n[data]').replace(_RATES, '["120 rpm"]')
    for text in (arm, by_vectors):
        path.write_text(text, encoding="utf-8")
        budget(experiment_from_run(read(path)), _BATCH, 0)
    plan = six_positions()
    up = np.array([step.up for step in plan])
    calibrate_batch(
        {
            "position": np.array([step.label for step in plan]),
            **{f"acc_{axis}": np.tile(up[:, k], (_BATCH, 1)) for k, axis in enumerate("xyz")},
        },
        method="six_position",
        sensor={"accelerometer": {"unit": "g"}},
        bench={"gravity": "9.81 m/s² ± 0.1 mm/s²", "tilt": "0.1 °"},
        label="position",
        sd={"accelerometer": "0.1 mg"},
    )


def _check_packets() -> None:
    """Check packets in writable and read-only bytes, because Numba compiles a kernel for each."""
    start, stop = np.array([0]), np.array([9])
    received = np.frombuffer(b"123456789", np.uint8)
    for data in (received, received.copy()):
        for check in CHECKS.values():
            check.span_checks(data, start, stop)


def _find_noise() -> None:
    """Compute the Allan deviation at enough averaging times for its kernel to be used."""
    deviations(np.sin(np.arange(50_000.0) ** 2), 1.0, spacing="all")

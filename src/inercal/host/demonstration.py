"""The demonstration: calibrates an IMU on a simulated three-axis table and checks the result.

Table and IMU are separate processes, connected through TCP and a pseudo-terminal, and the host is
the same as on a real bench. The clock of the bench waits for the host, so the minutes of the plan
pass in seconds, and the numbers are the same as in real time.

The result is compared with the truth in the run file. For the biases, the truth includes the mean
of the simulated flicker noise over the recording, because this is the definition of the bias
(`methods.turntable.drift`).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from inercal.basics.errors import InercalError
from inercal.host.bench_run import BenchRun
from inercal.host.bench_simulator import start_bench_simulator
from inercal.host.packets import read_layout
from inercal.host.run_execution import RunInterrupted, execute_run, finish_run
from inercal.host.run_folder import create_run, prepare_folder
from inercal.host.sim.mimu import mean_drift, packet_rate
from inercal.host.sim.simulated_errors import draw_errors
from inercal.pipeline import Outcome
from inercal.pipeline.outcome import true_coefficients
from inercal.report import require_report_packages
from inercal.runfile import Run, read

_PACKETS = "fixed"
RUN_FILE, _PATH = "mimu.toml", "path.csv"


@dataclass(frozen=True, eq=False)
class DemonstrationResult:
    """The result of the demonstration.

    Parameters
    ----------
    outcome : Outcome
    truth : mapping of str to float
        True coefficients in SI units; the biases are means over the run.
    nees : float
        Normalised estimation error squared, relative to the truth, per coefficient; 1 is expected.
    seconds : float
        Duration of the run in bench time, s.
    speed : float
        Bench seconds per second of wall time.
    files : mapping of str to str
    """

    outcome: Outcome
    truth: Mapping[str, float]
    nees: float
    seconds: float
    speed: float
    files: Mapping[str, str]


def demo(
    folder: str | Path,
    seed: int = 0,
    *,
    quick: bool = False,
    show: Callable[[BenchRun], None] = lambda run: None,
    compiling: Callable[[], None] = lambda: None,
) -> DemonstrationResult:
    """Run the demonstration: calibrate live and from the recording, compare, write a report.

    Parameters
    ----------
    folder : path
        Folder for the files of the run; it is created if needed.
    seed : int
        Seed of the sensor's noise and of the bench's imperfections.
    quick : bool
        Whether to use a path of five minutes instead of 24.
    show : callable
        Function that is called with the run while it is active.
    compiling : callable
        Function that is called if kernels must be compiled.

    Raises
    ------
    InputError
        The folder cannot be created, or already contains a run.
    InercalError
        The run was interrupted.
    """
    require_report_packages()
    prepare_folder(folder)
    with TemporaryDirectory() as plans:
        run = _write_run_file(Path(plans), quick=quick)
        with start_bench_simulator(run, seed, _PACKETS, compiling) as bench:
            # The processes of the bench have read the run file. From here on, the copy in the
            # folder is used.
            result, journal = create_run(folder, run, bench.addresses)
            with journal, result.removed_on_failure():
                try:
                    run_process = execute_run(
                        result, journal, show=show, run_context=lambda _: bench.run_context()
                    )
                except RunInterrupted as error:
                    raise InercalError(
                        f"{folder}: the run of the demonstration was interrupted: {error}; start "
                        "it again in another folder"
                    ) from None

                def truth(outcome: Outcome) -> Mapping[str, float]:
                    return _truth_with_mean_biases(run, seed, outcome, run_process.time)

                outcome, written, _ = finish_run(
                    result, journal, run_process.recorder.live_estimator, truth=truth
                )
    calibration, drifting = outcome.calibration, truth(outcome)
    true = true_coefficients(calibration, drifting)
    error = calibration.values - np.array([true[n] for n in calibration.sensor.coefficients])
    nees = float(error @ np.linalg.solve(calibration.covariance, error)) / len(error)
    return DemonstrationResult(
        outcome, drifting, nees, run_process.time, run_process.speed, written
    )


def _truth_with_mean_biases(
    run: Run, seed: int, outcome: Outcome, end: float
) -> Mapping[str, float]:
    """Return the truth, with biases as means over the recording, which ends at time `end`.

    The error of the IMU's clock is negligible for this purpose.
    """
    track = outcome.observations.track
    assert track is not None
    lasting = float(track.time[-1] - track.time[0])
    rate = packet_rate(run, read_layout(_PACKETS), None)
    drift = mean_drift(run, draw_errors(run, seed), rate, end - lasting, end)
    result = dict(run.truth)
    for channel, mean in zip(run.sensor.channels, drift.tolist(), strict=True):
        for name in (f"{channel}.bias", f"{channel}.k0"):
            if name in result:
                result[name] += mean
    return result


def _write_run_file(folder: Path, *, quick: bool) -> Run:
    """Write the demonstration's run file to a folder and return it."""
    packaged = files("inercal")
    text = packaged.joinpath("demo.toml").read_text(encoding="utf-8")
    if quick:
        text = text.replace('path = "fast"', f'path = "{_PATH}"')
        (folder / _PATH).write_bytes(packaged.joinpath("demo_path.csv").read_bytes())
    (folder / RUN_FILE).write_text(text, encoding="utf-8")
    return read(folder / RUN_FILE)

"""The demonstration: an IMU on a simulated three-axis table, calibrated live, and judged.

Table and IMU are processes of their own behind TCP and a pseudo-terminal; what runs them is what
runs a bench of iron. Their clock waits for the host, so that the plan's minutes pass in seconds and
the numbers are those of an unhurried run.

The truth that it is judged by is that of the run file and, of the biases, the mean of the simulated
flicker over the recording: so the bias is defined (`methods.turntable.drift`).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from inercal.errors import InercalError
from inercal.host.execute import Interrupted, carried_out
from inercal.host.finish import finish
from inercal.host.folder import begin, require_free
from inercal.host.packets import read_layout
from inercal.host.run import BenchRun
from inercal.host.sim.errors import draw
from inercal.host.sim.mimu import mean_drift, rate_of
from inercal.host.simulated import POLL, started
from inercal.pipeline import Outcome
from inercal.pipeline.truth import in_frame_of
from inercal.runfile import Run, read

_PACKETS = "fixed"
_RUN_FILE, _PATH = "mimu.toml", "path.csv"


@dataclass(frozen=True, eq=False)
class Demo:
    """What came of it.

    Parameters
    ----------
    outcome : Outcome
    truth : mapping of str to float
        SI, of the biases the mean over the run.
    nees : float
        Normalised error squared against the truth, a coefficient; 1 is expected.
    seconds : float
        Of the bench.
    speed : float
        Seconds of the bench in one of the wall's.
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
) -> Demo:
    """Run the plan on a simulated bench, calibrate live and from the recording, compare, report.

    Parameters
    ----------
    folder : path
        Made if need be; holds the run's files afterwards.
    seed : int
        Of the sensor's noise and of what is imperfect of the bench.
    quick : bool
        A path of five minutes instead of 24.
    show : callable
        Called with the run while it goes on.

    Raises
    ------
    InputError
        The folder cannot be made, or holds a run already.
    InercalError
        The run was interrupted.
    """
    require_free(folder)
    with TemporaryDirectory() as plans:
        run = _plan(Path(plans), quick=quick)
        with started(run, seed, _PACKETS) as bench:
            # The bench's processes have read the run file; from here on its copy counts.
            made, journal = begin(folder, run, bench.addresses, POLL)
            with journal, made.kept_if_begun():
                try:
                    going = carried_out(made, journal, show=show, beside=lambda _: bench.beside())
                except Interrupted as error:
                    raise InercalError(f"{folder}: the run was interrupted: {error}") from None

                def truth(outcome: Outcome) -> Mapping[str, float]:
                    return _averaged(run, seed, outcome, going.time)

                outcome, written = finish(made, journal, going.account.live, truth=truth)
    calibration, drifting = outcome.calibration, truth(outcome)
    true = in_frame_of(calibration, drifting)
    error = calibration.values - np.array([true[n] for n in calibration.sensor.coefficients])
    nees = float(error @ np.linalg.solve(calibration.covariance, error)) / len(error)
    return Demo(outcome, drifting, nees, going.time, going.speed, written)


def _averaged(run: Run, seed: int, outcome: Outcome, end: float) -> Mapping[str, float]:
    """Return the truth with biases as means over the recording, which ends with the bench's time.

    The IMU's clock may be off, by what is nothing here.
    """
    track = outcome.observations.track
    assert track is not None
    lasting = float(track.time[-1] - track.time[0])
    rate = rate_of(run, read_layout(_PACKETS), None)
    drift = mean_drift(run, draw(run, seed), rate, end - lasting, end)
    made = dict(run.truth)
    for channel, mean in zip(run.sensor.channels, drift.tolist(), strict=True):
        for name in (f"{channel}.bias", f"{channel}.k0"):
            if name in made:
                made[name] += mean
    return made


def _plan(folder: Path, *, quick: bool) -> Run:
    """Return the demonstration's run file, written to a folder."""
    packaged = files("inercal")
    text = packaged.joinpath("demo.toml").read_text(encoding="utf-8")
    if quick:
        text = text.replace('path = "fast"', f'path = "{_PATH}"')
        (folder / _PATH).write_bytes(packaged.joinpath("demo_path.csv").read_bytes())
    (folder / _RUN_FILE).write_text(text, encoding="utf-8")
    return read(folder / _RUN_FILE)

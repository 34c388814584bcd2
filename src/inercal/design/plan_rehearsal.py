"""Expected uncertainties of a plan by hand, from simulations of the plan."""

from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path

import numpy as np

from inercal.arrays import Array
from inercal.errors import InputError
from inercal.methods.temperature import refuse_temperature_terms_in_plan
from inercal.pipeline import read_out
from inercal.plan import Hold, Step
from inercal.recording import Mark, Recording
from inercal.runfile import Run
from inercal.segments import marks_from_labels, observe, transitions_between_rests
from inercal.sensors import Sensor

SESSIONS = 5
_SETTLING = 0.25  # s


@dataclass(frozen=True, eq=False)
class RehearsalResult:
    """A plan and its expected uncertainties.

    Parameters
    ----------
    steps : tuple of Step
    sensor : Sensor
        With the coefficients that are estimated.
    std : (p,) array
        Expected standard uncertainties, SI: the median over rehearsals.
    seconds : float
        Of the complete plan with its moves.
    """

    steps: tuple[Step, ...]
    sensor: Sensor
    std: Array
    seconds: float


def default_run_file() -> Path:
    """Return the packaged run file of a usual MEMS IMU in the hand."""
    return Path(str(files("inercal") / "hand_held.toml"))


def rehearse_plan(run: Run, sessions: int = SESSIONS) -> RehearsalResult:
    """Simulate the run's plan, and return the uncertainties that its estimator states.

    Parameters
    ----------
    run : Run
        Of a method with free attitudes; only its sensor's noise and its bench matter.
    sessions : int
        Simulations; their median is robust against one that a χ² enlarges by chance.

    Raises
    ------
    InputError
        No noise of the sensor, no rate, or a method with known attitudes.
    """
    if not run.method.unknown_attitudes:
        raise InputError(
            f"the plan of method {run.method.name} is fixed; use multi_position",
            key="[method] name",
        )
    refuse_temperature_terms_in_plan(run.sensor)
    if run.rate_hz is None:
        raise InputError(
            f'{run.path}: [data] rate is missing; add it for the simulation, such as rate = "100 '
            'Hz"',
            file=run.path,
            key="[data] rate",
        )
    for axis in run.sensor.axes:
        if not axis.noise.white:
            key = f"[sensor.{'accelerometer' if axis.measures == 'f' else 'gyro'}] white"
            raise InputError(
                f"{run.path}: {key} is missing; add it for the simulation", file=run.path, key=key
            )
    std: list[Array] = []
    p, seconds = len(run.sensor.coefficients), 0.0
    estimator = run.method.estimator(run.estimator)
    for seed in range(sessions):
        recording = _simulate_recording(run, run.rate_hz, np.random.default_rng(seed))
        seconds = recording.duration
        holds = tuple(step for step in run.steps if isinstance(step, Hold))
        marks = _trimmed_marks(recording)
        seen = observe(recording, run.sensor, marks, holds, by_hand=True)
        if run.sensor.select_axes("w").axes:
            seen = replace(
                seen, transitions=transitions_between_rests(recording, run.sensor, marks)
            )
        estimate = estimator(seen, run.sensor, run.bench, run.steps, run.priors)
        std.append(estimate.std[:p])
    return RehearsalResult(run.steps, run.sensor, np.median(std, axis=0), seconds)


def _simulate_recording(run: Run, rate_hz: float, rng: np.random.Generator) -> Recording:
    steps = [step for step in run.steps if isinstance(step, run.kind.steps)]
    done = run.kind.simulate(run.bench, steps, rate_hz, rng, 1, run.sensor, True).simulated_motion
    c = np.zeros(len(run.sensor.coefficients))
    data = read_out(run.sensor, done.motion, c, rate_hz, rng)[0]
    units = tuple(axis.readout.unit for axis in run.sensor.axes)
    return Recording(done.time, data, run.sensor.channels, units, done.labels)


def _trimmed_marks(recording: Recording) -> tuple[Mark, ...]:
    # The hand is steady some time after it arrives and before it leaves.
    trim = round(_SETTLING * recording.rate_hz)
    return tuple(
        replace(mark, start=mark.start + trim, stop=mark.stop - trim)
        for mark in marks_from_labels(recording)
    )

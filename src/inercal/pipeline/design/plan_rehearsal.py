"""Expected uncertainties of a hand-held plan, from simulations of the plan."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.parallel import Executor, SerialExecutor, in_order
from inercal.benches.kind_definition import Simulate
from inercal.estimation import Estimate, Gaussian
from inercal.methods.temperature import refuse_temperature_terms_in_plan
from inercal.physics.plan import Hold, Step
from inercal.physics.sensors import Sensor
from inercal.pipeline import read_out
from inercal.recordings import Mark, Recording
from inercal.recordings.segments import (
    average_sections,
    marks_from_labels,
    transitions_between_rests,
)
from inercal.runfile import Run

SESSIONS = 5
_SETTLING = 0.25  # s


@dataclass(frozen=True, eq=False)
class RehearsalResult:
    """A rehearsed plan with its expected uncertainties.

    Parameters
    ----------
    steps : tuple of Step
    sensor : Sensor
        Sensor with the coefficients that are estimated.
    std : (p,) array
        Expected standard uncertainties, SI: the median over the rehearsals.
    seconds : float
        Duration of the complete plan, including its moves.
    """

    steps: tuple[Step, ...]
    sensor: Sensor
    std: Array
    seconds: float


def default_run_file() -> Path:
    """Return the packaged run file for a typical MEMS IMU calibrated by hand."""
    return Path(str(files("inercal") / "hand_held.toml"))


def rehearse_plan(
    run: Run, sessions: int = SESSIONS, executor: Executor | None = None
) -> RehearsalResult:
    """Simulate the plan of a run, and return the uncertainties that its estimator states.

    Parameters
    ----------
    run : Run
        Run with unknown attitudes. Only the noise of the sensor and the bench matter.
    sessions : int
        Number of simulations; their median is used because a single χ² may be large by chance.
    executor : Executor, optional
        Executor for the simulations. By default, they run in this process. The result does not
        depend on the executor.

    Raises
    ------
    InputError
        If the noise of the sensor or the rate is not stated, or if the method has known attitudes.
    """
    if not run.method.unknown_attitudes:
        raise InputError(
            f"the plan of method {run.method.name} is fixed; use method multi_position",
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
    rehearsal = _Rehearsal(
        run.kind.simulate, run.bench, run.steps, run.kind.steps, run.sensor, run.priors,
        run.method.estimator(run.estimator), run.rate_hz,
    )  # fmt: skip
    executor = executor or SerialExecutor()
    for seed in range(sessions):
        executor.submit(rehearsal, seed)
    found: list[_Session] = list(in_order(executor))
    std = np.median([one.std for one in found], axis=0)
    return RehearsalResult(run.steps, run.sensor, std, found[-1].seconds)


class _Session(NamedTuple):
    """Standard uncertainties from one simulation, (p,), SI, and its duration, s."""

    std: Array
    seconds: float


@dataclass(frozen=True, eq=False)
class _Rehearsal:
    """A simulation of a plan and its calibration; another process can execute this."""

    simulate: Simulate[Any]
    bench: Any
    steps: tuple[Step, ...]
    simulated_steps: tuple[type[Step], ...]
    sensor: Sensor
    priors: tuple[Gaussian, ...]
    estimator: Callable[..., Estimate]
    rate_hz: float

    def __call__(self, seed: int) -> _Session:
        recording = self._recording(np.random.default_rng(seed))
        holds = tuple(step for step in self.steps if isinstance(step, Hold))
        marks = _trimmed_marks(recording)
        seen = average_sections(recording, self.sensor, marks, holds, by_hand=True)
        if self.sensor.select_axes("w").axes:
            turns = transitions_between_rests(recording, self.sensor, marks)
            seen = replace(seen, transitions=turns)
        estimate = self.estimator(seen, self.sensor, self.bench, self.steps, self.priors)
        return _Session(estimate.std[: len(self.sensor.coefficients)], recording.duration)

    def _recording(self, rng: np.random.Generator) -> Recording:
        steps = [step for step in self.steps if isinstance(step, self.simulated_steps)]
        done = self.simulate(
            self.bench, steps, self.rate_hz, rng, 1, self.sensor, True
        ).simulated_motion
        c = np.zeros(len(self.sensor.coefficients))
        data = read_out(self.sensor, done.motion, c, self.rate_hz, rng)[0]
        units = tuple(axis.readout.unit for axis in self.sensor.axes)
        return Recording(
            done.time,
            data,
            self.sensor.channels,
            units,
            done.labels,
            source="the planned recording",
        )


def _trimmed_marks(recording: Recording) -> tuple[Mark, ...]:
    # The hand is not steady just after it arrives and just before it leaves.
    trim = round(_SETTLING * recording.rate_hz)
    return tuple(
        replace(mark, start=mark.start + trim, stop=mark.stop - trim)
        for mark in marks_from_labels(recording)
    )

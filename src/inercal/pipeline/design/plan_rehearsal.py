"""Expected uncertainties of a hand-held plan, from simulations of the plan.

They are those that the estimator of a run states for its plan. The readings are simulated for the
declared bench, with the stated noise and priors (`inercal.pipeline.budget.virtual_experiment`). The
data of the run are not read.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, NotObserved
from inercal.basics.parallel import Executor, SerialExecutor, in_order
from inercal.benches.kind_definition import Simulate
from inercal.estimation import Estimate, Gaussian
from inercal.methods import AddMagnetometers, Fit
from inercal.methods.temperature import refuse_temperature_terms_in_plan
from inercal.physics.plan import Hold, Step, Turn, with_second_azimuths
from inercal.physics.quantities import QUANTITIES
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import Sensor
from inercal.pipeline import read_out
from inercal.pipeline.budget.experiment_from_runfile import experiment_from_run
from inercal.recordings import Mark, Observations, Recording, segments
from inercal.recordings.data.recording_loader import stated_deviations
from inercal.recordings.magnetic import MagneticReadings
from inercal.recordings.segments.magnetic_means import average_magnetometers, average_pieces
from inercal.runfile import Run


@dataclass(frozen=True)
class ExpectedUncertainty:
    """The expected uncertainty of a coefficient, or of the sum of two coefficients.

    Parameters
    ----------
    name, meaning : str
    unit : str
        Unit in which the coefficient is printed.
    size : float
        Size of the unit in SI units.
    std : float
        Standard uncertainty, SI.
    """

    name: str
    meaning: str
    unit: str
    size: float
    std: float


def estimate_of_plan(run: Run, rows: str) -> Estimate:
    """Run the estimator on simulated readings of a run's plan, and return the estimate.

    Parameters
    ----------
    run : Run
        Run with known attitudes or with means.
    rows : str
        Word for the rows of the plan in messages, "positions" or "states".

    Raises
    ------
    InputError
        If no noise is stated, or the estimator gives no result for this plan.
    NotObserved
        If the plan does not determine all coefficients.
    """
    experiment = experiment_from_run(run, free_attitudes=run.data.kind == "means")
    try:
        estimate = experiment.estimate()
    except NotObserved as error:
        text = f"the plan of {len(run.steps)} {rows} does not determine the coefficients"
        raise error.located(text).located(run.path) from None
    except InputError as error:
        raise error.located(run.path) from None
    if not (np.all(estimate.converged) and np.isfinite(estimate.covariance).all()):
        raise InputError(
            f"estimator {run.estimator} has no result for this plan; check the stated noise and "
            "[sensor.truth]"
        ).located(run.path)
    return estimate


def estimated_uncertainties(estimate: Estimate, sensor: Sensor) -> tuple[ExpectedUncertainty, ...]:
    """Return the expected uncertainty of each coefficient of the sensor."""
    # The covariance is not scaled by the residuals, because the scatter of one draw of the noise
    # says nothing about the plan.
    std = np.sqrt(np.diagonal(estimate.covariance)[: len(sensor.coefficients)])
    return coefficient_uncertainties(
        sensor, dict(zip(sensor.coefficients, std.tolist(), strict=True))
    )


def coefficient_uncertainties(
    sensor: Sensor, std: Mapping[str, float]
) -> tuple[ExpectedUncertainty, ...]:
    """Combine the coefficients of the sensor with standard uncertainties by name, SI."""
    lines = [(name, sensor.coefficient(name)) for name in sensor.coefficients]
    return tuple(
        ExpectedUncertainty(name, line.meaning, line.unit, line.si, std[name])
        for name, line in lines
    )


SESSIONS = 5
_SETTLING = 0.25  # s
_RATE_HZ = 50.0  # of the simulation of a table of means


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
        Run with unknown attitudes. Only the bench and the noise of the sensor matter.
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
    if run.method.follows_rest:
        raise InputError(
            f"method {run.method.name} follows any motion and has no plan; turn the sensor slowly "
            "about all of its axes for a minute or two",
            key="[method] name",
        )
    if run.rate_hz is None:
        reason = 'is missing; add it for the simulation, such as rate = "100 Hz"'
        raise key_error("[data] rate", reason, run.path)
    return _rehearsed(run, sessions, executor)


def magnetometer_uncertainties(run: Run) -> tuple[ExpectedUncertainty, ...]:
    """Return the expected uncertainties of the magnetometers of a plan with a worksheet.

    If the noise is only stated for means, it is assumed to be white. See `rehearse_plan` for the
    errors.
    """
    if run.magnetometer is None:
        return ()
    means = {kind: sd * run.steps[0].seconds ** 0.5 for kind, sd in stated_deviations(run).items()}
    sensor, field = (_with_white(one, means) for one in (run.sensor, run.magnetometer))
    run = replace(run, sensor=sensor, magnetometer=field, rate_hz=run.rate_hz or _RATE_HZ)
    found = _rehearsed(run, SESSIONS, None)
    std = dict(zip(found.sensor.coefficients, found.std.tolist(), strict=True))
    return coefficient_uncertainties(field, std)


def _with_white(sensor: Sensor, means: Mapping[str, float]) -> Sensor:
    """Return the sensor with the white noise of means, by kind of axes, where none is stated."""
    axes = (
        replace(a, noise=replace(a.noise, white=a.noise.white or means.get(a.measures, 0.0)))
        for a in sensor.axes
    )
    return replace(sensor, axes=tuple(axes))


def _rehearsed(run: Run, sessions: int, executor: Executor | None) -> RehearsalResult:
    sensor, steps, free = run.whole_sensor, run.steps, run.method.unknown_attitudes
    assert run.rate_hz is not None
    refuse_temperature_terms_in_plan(sensor)
    if not free:
        steps = tuple(with_second_azimuths(s for s in steps if isinstance(s, Hold | Turn)))
    for axis in sensor.axes:
        if not axis.noise.white:
            key = f"[sensor.{QUANTITIES[axis.measures].sensor}] white"
            raise key_error(key, "is missing; add it for the simulation", run.path)
    rehearsal = _Rehearsal(
        run.kind.simulate, run.bench, steps, run.kind.steps, run.sensor, run.priors,
        run.method.estimator(run.estimator), run.rate_hz, run.magnetometer,
        run.method.add_magnetometers, free,
    )  # fmt: skip
    executor = executor or SerialExecutor()
    for seed in range(sessions):
        executor.submit(rehearsal, seed)
    found: list[_Session] = list(in_order(executor))
    std = np.median([one.std for one in found], axis=0)
    return RehearsalResult(steps, sensor, std, found[-1].seconds)


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
    magnetometer: Sensor | None = None
    add_magnetometers: AddMagnetometers[Any, Any] | None = None
    free: bool = True  # whether the attitudes are unknown

    def __call__(self, seed: int) -> _Session:
        recording = self._recording(np.random.default_rng(seed))
        holds = tuple(step for step in self.steps if isinstance(step, Hold))
        marks = _trimmed_marks(recording)
        seen = segments.average_sections(recording, self.sensor, marks, holds, by_hand=self.free)
        if self.free and self.sensor.select_axes("w").axes:
            turns = segments.transitions_between_rests(recording, self.sensor, marks)
            seen = replace(seen, transitions=turns)
        estimate = self.estimator(seen, self.sensor, self.bench, self.steps, self.priors)
        count = len(self.sensor.coefficients)
        if self.magnetometer is not None and self.add_magnetometers is not None:
            seen = replace(seen, magnetic=self._magnetic(self.magnetometer, recording, marks, seen))
            fit = Fit("", self.sensor, self.bench, seen, self.steps, self.priors, estimate)
            estimate, _ = self.add_magnetometers(fit, self.magnetometer)
            count += len(self.magnetometer.coefficients)
        return _Session(estimate.std[:count], recording.duration)

    def _magnetic(
        self, own: Sensor, recording: Recording, marks: Sequence[Mark], seen: Observations
    ) -> MagneticReadings:
        spans = [(recording.time[m.start], recording.time[m.stop - 1]) for m in marks]
        found, _ = average_magnetometers(recording, own, spans, [m.label for m in marks])
        if seen.transitions is None:
            return found
        return replace(found, pieces=average_pieces(recording, own, seen.transitions, self.sensor))

    def _recording(self, rng: np.random.Generator) -> Recording:
        steps = [step for step in self.steps if isinstance(step, self.simulated_steps)]
        own = self.magnetometer
        sensor = self.sensor if own is None else self.sensor.beside(own)
        made = self.simulate(self.bench, steps, self.rate_hz, rng, 1, sensor, self.free)
        done = made.simulated_motion
        c = np.zeros(len(sensor.coefficients))
        data = read_out(sensor, done.motion, c, self.rate_hz, rng)[0]
        units = tuple(axis.readout.unit for axis in sensor.axes)
        return Recording(
            done.time, data, sensor.channels, units, done.labels, source="the planned recording"
        )


def _trimmed_marks(recording: Recording) -> tuple[Mark, ...]:
    # The hand is not steady just after it arrives and just before it leaves.
    trim = round(_SETTLING * recording.rate_hz)
    marks = segments.marks_from_labels(recording)
    return tuple(replace(m, start=m.start + trim, stop=m.stop - trim) for m in marks)

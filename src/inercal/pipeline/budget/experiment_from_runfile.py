"""Build the virtual experiment for a budget from a run file; the readings are not used."""

from collections.abc import Mapping, Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, error_location
from inercal.basics.small_files import is_file
from inercal.methods.temperature import refuse_temperature_terms_in_plan
from inercal.physics.plan import Step
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import Axis
from inercal.pipeline.budget.virtual_experiment import Experiment, require_budget_plan
from inercal.recordings.data.recording_loader import stated_deviations
from inercal.runfile import Run


def rows_of_table(run: Run) -> tuple[Step, ...]:
    """Return the steps that the rows of a table of means define.

    The result is empty if the data are a recording, if [method] states a plan, or if the table does
    not exist yet. The plan of the method then applies.

    Raises
    ------
    InputError
        The table cannot be read.
    """
    if run.data.kind != "means" or run.has_plan_keys or not is_file(run.file(run.data.file)):
        return ()
    with error_location(run.path):
        return tuple(run.kind.observe(run).steps)


def experiment_from_run(
    run: Run, *, free_attitudes: bool = False, rows: Sequence[Step] = ()
) -> Experiment:
    """Return the experiment that a run file describes.

    Parameters
    ----------
    run : Run
    free_attitudes : bool
        Whether methods that estimate the attitudes from means are accepted.
    rows : sequence of Step, optional
        Steps of a table of means (`rows_of_table`), which replace those of the plan.

    The noise of a mean is its stated deviation ([data.sd]). If none is stated, it is the white
    noise of the axis, averaged over the step. If [sensor.truth] does not state a coefficient that
    has a prior, the true value is the value of the prior.

    Raises
    ------
    InputError
        If the method has no plan of attitudes, or no noise is stated.
    """
    if run.method.unknown_attitudes and not free_attitudes:
        raise InputError(
            f"a budget needs a plan with attitudes, but method {run.method.name} estimates "
            "attitudes from the recording; use inercal plan, which simulates a recording",
            key="[method] name",
        ).located(run.path)
    if run.kind.rows_of_table and run.data.kind == "means" and not (run.has_plan_keys or rows):
        raise InputError(
            "a budget needs a plan, but the run file names a table: state [method] attitudes, "
            "rates or turns",
            key="[method]",
        ).located(run.path)
    with error_location(run.path):
        refuse_temperature_terms_in_plan(run.sensor)
        steps = tuple(run.kind.fitted(rows or run.steps))
        bench = require_budget_plan(run.bench, steps)
        believed = {
            name: float(value)
            for prior in run.priors
            for name, value in zip(prior.names, prior.mean, strict=True)
        }
        return Experiment(
            run.sensor,
            bench,
            steps,
            run.solver(),
            _noise_covariance(run, steps),
            run.priors,
            believed | dict(run.truth),
        )


def omitted_drift_notes(run: Run) -> tuple[str, ...]:
    """Return notes about drift that a calibration includes, but no plan or budget.

    A plan does not know when its steps will be carried out. A table of means contains no drift.
    """
    if run.data.kind != "recording":
        return ()
    slow = [axis.noise.bias_instability or axis.noise.random_walk for axis in run.sensor.axes]
    if any(slow):
        return (
            "These uncertainties do not include bias_instability and random_walk. A calibration of "
            "the recording includes both.",
        )
    if not (run.kind.drift_from_slopes and run.sensor.select_axes("f").axes):
        return ()
    return (
        "These uncertainties do not include drift. A recording of this plan cannot exclude a drift "
        "of the accelerometers, so its calibration states a U of their biases that is several "
        "times larger. If you know bias_instability, state it in [sensor.accelerometer].",
    )


def _noise_covariance(run: Run, steps: Sequence[Step]) -> Array:
    """Return the covariance of the mean readings, (r, m, m), SI."""
    stated = stated_deviations(run)
    variance = np.array(
        [[_mean_variance(stated, a, step.seconds) for a in run.sensor.axes] for step in steps]
    )
    return variance[..., None] * np.eye(variance.shape[1])


def _mean_variance(stated: Mapping[str, float], axis: Axis, seconds: float) -> float:
    kind = QUANTITIES[axis.measures].sensor
    if axis.measures in stated:
        return stated[axis.measures] ** 2
    if not axis.noise.white:
        raise InputError(
            f"[sensor.{kind}] white is missing: the uncertainties of a plan or budget need it; "
            f"state it, or the standard deviation of a mean, [data.sd] {kind}",
            key=f"[sensor.{kind}] white",
        )
    if not seconds:
        raise InputError(
            "the plan does not state how long its steps take, which is needed for white noise; "
            "state [method] seconds",
            key="[method] seconds",
        )
    return axis.noise.white**2 / seconds

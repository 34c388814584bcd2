"""Register the dividing head as a kind of bench, with its report and its simulation.

The report shows the estimated angles and describes each row. The simulation moves from position to
position.
"""

from collections.abc import Sequence
from math import degrees, pi
from typing import TYPE_CHECKING

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.contract import SensorSimulation, SimulatedMotion
from inercal.benches.dividing_head.bench import (
    DividingHead,
    bias_drift,
    mounted_sensor,
    sensed_motion,
    sensor_in_plane,
)
from inercal.benches.dividing_head.passes import (
    pass_names,
    pass_numbers,
    sensor_angles,
    steps_without_warm_up,
)
from inercal.benches.dividing_head.settings import DividingHeadData, DividingHeadSection, build
from inercal.benches.dividing_head.sheet import sheet
from inercal.benches.kind_definition import Kind, Vocabulary
from inercal.benches.report_data import MeasuredDirection, Panel, Plot, ReportInput, Series
from inercal.benches.stated_axes import StatedAxes
from inercal.physics.motion import Motion
from inercal.physics.plan import Index, Step
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Recording
from inercal.recordings.data import EstimatorInput, RunBase

if TYPE_CHECKING:
    from inercal.recordings.segments import RestDetection

MOVE_SECONDS = 2.0


def simulate_head_motion(
    bench: DividingHead,
    steps: Sequence[Index],
    rate_hz: float,
    rng: np.random.Generator,
    trials: int,
    sensor: Sensor,
    carried: bool,
) -> SensorSimulation:
    """Simulate the motion in each trial, the readback and the drift of the biases.

    Parameters
    ----------
    bench : DividingHead
        The bench. Its parameters are drawn from normal distributions with their stated standard
        deviations.
    steps : sequence of r Index
    rate_hz : float
        Samples per second.
    rng : Generator
    trials : int
        Number of trials, which is the leading axis of the drawn errors and the motion.
    sensor : Sensor
        The sensor, with m accelerometers.
    carried : bool
        Not used, because the head moves the sensor from position to position.
    """
    declared = bench.simulated_parameters(steps, sensor.channels)
    drawn = bench.qualified.draw(declared, rng, trials)
    f = np.broadcast_to(sensed_motion(bench, steps, drawn).f, (trials, len(steps), 3))
    drift = bias_drift(steps, sensor.channels, drawn)
    # `share` is the fraction of the move to the next position that is done, 0 at a position.
    move = round(MOVE_SECONDS * rate_hz)
    which: list[Array] = []
    for k, step in enumerate(steps):
        which.append(np.full(round(step.seconds * rate_hz), float(k)))
        if k + 1 < len(steps):
            which.append(k + (np.arange(move) + 0.5) / move)
    place = np.concatenate(which)
    row = place.astype(np.int64)
    share, after = place - row, np.minimum(row + 1, len(steps) - 1)
    angle = np.array([step.angle for step in steps])
    turned = pi - (pi - (angle[after] - angle[row])) % (2 * pi)
    between = (1 - share)[:, None] * f[:, row] + share[:, None] * f[:, after]
    size = np.linalg.norm(f[:, :1], axis=-1, keepdims=True)
    motion = Motion(size * between / np.linalg.norm(between, axis=-1, keepdims=True))
    names = np.array([step.label for step in steps])
    time = np.arange(place.size) / rate_hz
    nothing = np.zeros(place.size)
    readback = {"angle": angle[row] + share * turned, "autocollimator": nothing, "level": nothing}
    labels = np.where(share > 0, "", names[row])
    done = SimulatedMotion(time, motion, labels, drawn, readback)
    return SensorSimulation(done, sensor, drift[:, row])


_ARCSEC = pi / 648_000
_APART = 3.0  # ° between passes in the figure


def directions(shown: ReportInput) -> tuple[MeasuredDirection, ...]:
    """Return no directions, because the head may carry only one accelerometer."""
    return ()


def angle_corrections(shown: ReportInput) -> tuple[Array, Array]:
    """Return the estimated minus the stated angles and their standard deviations, (r,) each, rad.

    The mean difference is subtracted, because it cannot be distinguished from the mounting angles.
    The arrays are empty if the estimator does not estimate angles.
    """
    steps, estimate = _steps(shown), shown.estimate
    weights = {
        n: w for n, w in sensor_angles(shown.bench, steps).weights.items() if n in estimate.names
    }
    if not weights:
        return np.zeros(0), np.zeros(0)
    rows = np.stack(list(weights.values()), axis=-1)
    rows = rows - rows.mean(axis=0)
    found = estimate.select(tuple(weights))
    variance = np.einsum("rk,kl,rl->r", rows, found.covariance, rows)
    return rows @ found.value, np.sqrt(variance)


def plots(shown: ReportInput) -> tuple[Plot, ...]:
    """Return a plot of the estimated corrections to the head's angles, pass by pass."""
    error, sd = angle_corrections(shown)
    steps = _steps(shown)
    which = np.array(pass_numbers(steps))
    turned = np.array([degrees(step.angle) % 360 for step in steps])
    names = pass_names(steps)
    series = tuple(
        Series(
            turned[which == k] + _APART * (k - (len(names) - 1) / 2),
            error[which == k] / _ARCSEC,
            name,
            sd[which == k] / _ARCSEC,
        )
        for k, name in enumerate(names)
        if error.size
    )
    text = (
        "Estimated minus stated angles of the head. Their mean is subtracted, because it cannot be "
        "distinguished from the mounting of the accelerometers. Bars are ±2 standard "
        "uncertainties; if passes differ by more, there is an error that is not modelled."
    )
    panel = Panel("", "angle of the head, °", series, tuple(range(0, 361, 30)))
    return (
        Plot(
            "head",
            "Estimated minus stated angles of the head, with bars of ±2 standard uncertainties",
            text if error.size else "The estimator does not estimate the angles of the head.",
            "estimated − stated, ″",
            (panel,) if error.size else (),
        ),
    )


def _steps(shown: ReportInput) -> list[Index]:
    return [step for step in shown.steps if isinstance(step, Index)]


def describe_position(step: Step, outcome: ReportInput, number: int) -> str:
    """Describe a position and its readings, such as "head at 30°, forward; a 0.5 g"."""
    assert isinstance(step, Index)
    text = step.describe()
    if step.level:
        text += f"; level {step.level / _ARCSEC:+.2f}″"
    if step.reading:
        text += f"; autocollimator {step.reading / _ARCSEC:+.2f}″"
    observed = outcome.observations
    readings = [
        f"{channel} {value / G0:.7f} g"
        for channel, value in zip(observed.channels, observed.mean[number].tolist(), strict=True)
    ]
    return f"{text}; {', '.join(readings)}"


def _sensor(name: str, *stated: StatedAxes) -> Sensor:
    """Return the accelerometers on the head; without the key `axis` there are one or two."""
    accelerometers = next((one for one in stated if one.measures == "f"), None)
    columns = () if accelerometers is None else accelerometers.columns
    if others := [one.section for one in stated if one.measures != "f"]:
        raise key_error(
            others[0], "a dividing head is at rest during a reading; remove the section"
        )
    if accelerometers is not None and accelerometers.directions:
        return sensor_in_plane(name, accelerometers.axes())
    if accelerometers is None or len(columns) not in (1, 2):
        raise key_error(
            "[data] accelerometer",
            f"{len(columns)} columns are named; name one or two, for the accelerometers on the "
            'head, such as ["a", "b"], or state the directions of more in [sensor.accelerometer] '
            "axis",
            names=tuple(map(str, columns)),
        )
    letters = "ab"[: len(columns)]
    return mounted_sensor(name, letters, accelerometers.readout, accelerometers.noise)


def _observe(run: RunBase[DividingHeadData]) -> EstimatorInput:
    """Return the observations from a run; the reader is imported only when it is needed."""
    from inercal.benches.dividing_head.reading import observe

    return observe(run)


def _rests(run: RunBase[DividingHeadData], recording: Recording) -> "RestDetection":
    """Return the rests in a refused recording."""
    from inercal.recordings.data.rest_marks import rests_without_plan

    return rests_without_plan(run, recording)


KIND = Kind(
    "dividing_head",
    DividingHead,
    DividingHeadSection,
    DividingHeadData,
    build,
    (Index,),
    _observe,
    simulate_head_motion,
    words=Vocabulary(rows="positions", attitudes="Positions of the head", components=""),
    sensor=_sensor,
    sheet=sheet,
    rests=_rests,
    directions=directions,
    plots=plots,
    row=describe_position,
    fitted=steps_without_warm_up,
)

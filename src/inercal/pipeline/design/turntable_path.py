"""Plan the path of a turntable: its steps, its duration and the expected uncertainties.

The covariance of an estimate does not depend on the random noise, and it hardly depends on the
sensor. The estimator of the method therefore processes a recording of an ideal sensor on an ideal
table, with the stated noise and the stated uncertainties of the table.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from inercal.basics.errors import InputError, NotObserved
from inercal.benches.turntable import Turntable, require_turntable
from inercal.benches.turntable.attitude import motion, reference_attitude
from inercal.benches.turntable.reading.still_table_observation import find_rests
from inercal.benches.turntable.simulation import PathProfile, path_profile
from inercal.methods.systematic import vertical_turn_messages
from inercal.methods.temperature import refuse_temperature_terms_in_plan
from inercal.methods.turntable import model
from inercal.methods.turntable_kalman import METHOD as KALMAN
from inercal.methods.turntable_kalman.combined_estimate import run_filter
from inercal.methods.turntable_kalman.filter_config import FILTER_CONFIGS, FILTER_KINDS
from inercal.physics.plan import Position, TableStep
from inercal.pipeline.design.plan_rehearsal import (
    ExpectedUncertainty,
    coefficient_uncertainties,
    estimated_uncertainties,
)
from inercal.recordings import Observations, Track
from inercal.runfile import Run


# The following computes expected uncertainties of a path for a method that does not use the table's
# angles.
#
# A sensor without errors except white noise records the path on an ideal table. The method finds
# the rests in the gyro readings of this sensor.
def still_table_uncertainties(
    run: Run, bench: Turntable, track: Track
) -> tuple[tuple[ExpectedUncertainty, ...], tuple[str, ...]]:
    """Return expected uncertainties, and warnings about turns around the vertical.

    Parameters
    ----------
    run : Run
    bench : Turntable
        Ideal turntable.
    track : Track
        Track of the whole path.

    Raises
    ------
    InputError
        If the path has no rests.
    NotObserved
        If the path does not determine all coefficients.
    """
    noises = [axis.noise.white for axis in run.sensor.axes]
    # Without noise, the readings would be constant in a rest, as from a coarse converter.
    drawn = np.random.default_rng(0).standard_normal(track.reading.shape)
    root_rate = (track.time.size / max(float(np.ptp(track.time)), 1e-9)) ** 0.5
    track = replace(track, reading=track.reading + root_rate * np.array(noises) * drawn)
    rests = find_rests(track.time, track.reading, run.sensor)
    if not len(rests):
        raise InputError("the path has no rest of 5 s; add positions", key="[method] path")
    spans = [slice(start, stop) for start, stop in rests.tolist()]
    hold = np.full(track.time.size, -1, dtype=np.int64)
    for k, span in enumerate(spans):
        hold[span] = k
    labels = tuple(f"rest {k}" for k in range(1, len(spans) + 1))
    white = np.diag(np.array(noises) ** 2)
    seconds = np.array([float(np.ptp(track.time[span])) for span in spans])
    observations = Observations(
        labels=labels,
        mean=np.stack([track.reading[span].mean(axis=0) for span in spans]),
        covariance=white / seconds[:, None, None],
        duration=seconds,
        samples=np.diff(rests, axis=1)[:, 0],
        time=np.array([float(track.time[span].mean()) for span in spans]),
        channels=run.sensor.channels,
        track=Track(track.time, track.reading, track.angles, hold),
    )
    estimate = run.solver()(observations, run.sensor, bench, (), run.priors)
    attitudes = np.stack(
        [reference_attitude(bench, track.angles[(s.start + s.stop) // 2][None])[0] for s in spans]
    )
    return estimated_uncertainties(estimate, run.sensor), vertical_turn_messages(attitudes, labels)


_RATE = 100.0  # Hz
_OPEN = 0.2  # u over expected size, above which a coefficient is not determined
_SETTLING = 0.25  # s at the beginning of each hold


@dataclass(frozen=True, eq=False)
class PathStep:
    """One step of a turntable path.

    Parameters
    ----------
    number : int
        Number of the step, starting at 1.
    step : Position or Rotation
    move : float
        Duration of the move to the step, s.
    seconds : float
        Duration of the step, s.
    """

    number: int
    step: TableStep
    move: float
    seconds: float


@dataclass(frozen=True, eq=False)
class PathSheet:
    """The steps of a path and its expected uncertainties.

    Parameters
    ----------
    run : Run
    rows : tuple of PathStep
    expected : tuple of ExpectedUncertainty
        Expected uncertainty of each coefficient; NaN if the path does not improve the initial
        value.
    undecided : tuple of str
        Descriptions of combinations of coefficients that the path does not determine.
    warnings : tuple of str
        Warnings about turns that the method cannot observe.
    """

    run: Run
    rows: tuple[PathStep, ...]
    expected: tuple[ExpectedUncertainty, ...]
    undecided: tuple[str, ...]
    warnings: tuple[str, ...] = ()

    @property
    def seconds(self) -> float:
        """Duration of the path, including its moves."""
        return sum(row.move + row.seconds for row in self.rows)


def turntable_path_sheet(run: Run) -> PathSheet:
    """Return the steps and expected uncertainties of a turntable run; data are not read.

    Raises
    ------
    InputError
        If the run is on another bench, if no noise is stated, if the table cannot follow the path,
        or if the path does not start with a rest of 20 s.
    NotObserved
        If the path does not determine all coefficients. For filters, the sheet lists the directions
        instead.
    """
    bench = require_turntable(run)
    steps = run.table_steps
    try:
        refuse_temperature_terms_in_plan(run.sensor)
        way = path_profile(bench, steps)
        track = ideal_track(run, bench, way, steps)
        undecided: tuple[str, ...] = ()
        warnings: tuple[str, ...] = ()
        if run.method.without_angles:
            expected, warnings = still_table_uncertainties(run, bench, track)
        elif run.method.name == KALMAN.name:
            expected, undecided = _filter_uncertainties(run, bench, track)
        else:
            sections = _section_steps(way, steps)
            expected = _estimator_uncertainties(run, bench, track, sections, way)
    except (InputError, NotObserved) as error:
        raise error.located(run.path) from None
    return PathSheet(run, _path_steps(way, steps), expected, undecided, warnings)


def path_uncertainties(
    run: Run, steps: Sequence[TableStep], rate_hz: float
) -> tuple[tuple[ExpectedUncertainty, ...], tuple[str, ...]]:
    """Return expected uncertainties and warnings if the method does not use table angles.

    Parameters
    ----------
    run : Run
        Run with a method that does not use the table's angles.
    steps : sequence of Position or Rotation
        Steps of the path; they replace the steps of the run.
    rate_hz : float
        Sampling rate.

    Raises
    ------
    InputError
        If the table cannot follow the path, or the path has no rests.
    NotObserved
        If the path does not determine all coefficients.
    """
    bench = require_turntable(run)
    track = ideal_track(run, bench, path_profile(bench, steps), steps, rate_hz)
    return still_table_uncertainties(run, bench, track)


def ideal_track(
    run: Run,
    bench: Turntable,
    way: PathProfile,
    steps: Sequence[TableStep],
    rate_hz: float | None = None,
) -> Track:
    """Return the track of an ideal sensor on an ideal table, by default at the rate of the run.

    Parameters
    ----------
    run : Run
    bench : Turntable
    way : PathProfile
        Profile of the path through the steps.
    steps : sequence of Position or Rotation
    rate_hz : float, optional
    """
    rate = rate_hz or run.rate_hz or _RATE
    time = np.arange(int(way.ends[-1] * rate) + 1) / rate
    angles, rates, accelerations = way.evaluate(time)
    result = motion(bench, angles, rates, accelerations, {})
    reading = run.sensor.forward(result, np.zeros(len(run.sensor.coefficients)))
    section = np.searchsorted(way.ends, time)
    held = [k for k, step in enumerate(_section_steps(way, steps)) if isinstance(step, Position)]
    begun = time - np.append(0.0, way.ends)[section] >= _SETTLING * (section > 0)
    hold = np.where(np.isin(section, held) & begun, section, -1)
    return Track(time, reading, angles, hold)


def _section_steps(way: PathProfile, steps: Sequence[TableStep]) -> list[TableStep | None]:
    """Return the step to which each section of the path belongs; None for a move."""
    following = iter(steps)
    return [next(following) if label else None for label in way.labels]


def _path_steps(way: PathProfile, steps: Sequence[TableStep]) -> tuple[PathStep, ...]:
    rows: list[PathStep] = []
    move = 0.0
    for step, seconds in zip(
        _section_steps(way, steps), np.diff(way.ends, prepend=0.0), strict=True
    ):
        if step is None:
            move = float(seconds)
        else:
            rows.append(PathStep(len(rows) + 1, step, move, float(seconds)))
            move = 0.0
    return tuple(rows)


def _filter_uncertainties(
    run: Run, bench: Turntable, track: Track
) -> tuple[tuple[ExpectedUncertainty, ...], tuple[str, ...]]:
    """Return expected uncertainties from the filters, and directions that are not determined."""
    way = run.filter or FILTER_CONFIGS[run.estimator]
    found: dict[str, float] = {}
    undecided: list[str] = []
    for kind in FILTER_KINDS:
        filtered = run_filter(kind, run.sensor, bench, track, way, run.priors)
        names = filtered.triad.sensor.coefficients
        p = len(names)
        covariance = filtered.covariance[:p, :p]
        std = np.sqrt(np.diagonal(covariance))
        # A coefficient that is hardly better known than before the run is not a result.
        std = np.where(std < _OPEN * model.expected_size(filtered.triad), std, np.nan)
        found |= dict(zip(names, std.tolist(), strict=True))
        undecided += [free.words for free in model.undecided_directions(filtered.triad, covariance)]
    return coefficient_uncertainties(run.sensor, found), tuple(undecided)


def _estimator_uncertainties(
    run: Run, bench: Turntable, track: Track, sections: Sequence[TableStep | None], way: PathProfile
) -> tuple[ExpectedUncertainty, ...]:
    """Return expected uncertainties from an estimator that uses all sections at the same time."""
    spans = [
        (step, float(start), float(stop))
        for step, start, stop in zip(sections, np.append(0.0, way.ends), way.ends, strict=False)
        if step is not None
    ]
    start, stop = (np.array([span[k] for span in spans]) for k in (1, 2))
    white = np.array([axis.noise.white for axis in run.sensor.axes])
    at = [np.flatnonzero((track.time >= a) & (track.time <= b)) for _, a, b in spans]
    observations = Observations(
        labels=tuple(step.label for step, _, _ in spans),
        mean=np.array([track.reading[some].mean(axis=0) for some in at]),
        covariance=np.diag(white**2) / (stop - start)[:, None, None],
        duration=stop - start,
        samples=np.array([some.size for some in at]),
        time=0.5 * (start + stop),
        channels=run.sensor.channels,
        track=track,
    )
    steps = [step for step, _, _ in spans]
    estimate = run.solver()(observations, run.sensor, bench, steps, run.priors)
    return estimated_uncertainties(estimate, run.sensor)

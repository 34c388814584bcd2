"""The path of a turntable before it is run: its steps, how long it takes, what it will give.

The covariance of an estimate does not depend on the noise that is drawn, and hardly on the sensor:
the method's own estimator goes over the path as an ideal sensor would record it on an ideal table,
with noise and table as stated.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from inercal.benches.turntable import Turntable, turntable_of
from inercal.benches.turntable.attitude import motion
from inercal.benches.turntable.simulation import Travel, travel
from inercal.design.known import ExpectedUncertainty, alone, of_coefficients
from inercal.errors import InputError, NotObserved
from inercal.methods.temperature import require_planless
from inercal.methods.turntable import model
from inercal.methods.turntable_kalman import METHOD as KALMAN
from inercal.methods.turntable_kalman import follow
from inercal.methods.turntable_kalman.ways import KINDS
from inercal.plan import Position, TableStep
from inercal.recording import Observations, Track
from inercal.runfile import Run

_RATE = 100.0  # Hz
_OPEN = 0.2  # of what a coefficient may be before anything is known
_FIRST = 0.25  # s of each hold that go for settling


@dataclass(frozen=True, eq=False)
class Step:
    """A step of a path.

    Parameters
    ----------
    number : int
        From 1.
    step : Position or Rotation
    move : float
        How long the table takes to come there, s.
    seconds : float
        How long the step lasts, s.
    """

    number: int
    step: TableStep
    move: float
    seconds: float


@dataclass(frozen=True, eq=False)
class PathSheet:
    """What the table does, and what it will give.

    Parameters
    ----------
    run : Run
    rows : tuple of Step
    expected : tuple of ExpectedUncertainty
        Of each coefficient; of those that the path leaves as they were guessed it is NaN.
    undecided : tuple of str
        Directions of the coefficients that the path leaves open, in words.
    """

    run: Run
    rows: tuple[Step, ...]
    expected: tuple[ExpectedUncertainty, ...]
    undecided: tuple[str, ...]

    @property
    def seconds(self) -> float:
        """Of the whole path with its moves."""
        return sum(row.move + row.seconds for row in self.rows)


def worksheet(run: Run) -> PathSheet:
    """Return what a run on a turntable will give. Its data are not looked at.

    Raises
    ------
    InputError
        A run on another bench, no noise, a path that the table cannot follow, or no rest of 20 s
        at its start.
    NotObserved
        Directions that the path leaves open; of the filters they are told in the sheet.
    """
    bench = turntable_of(run)
    steps = run.table_steps
    try:
        require_planless(run.sensor)
        way = travel(bench, steps)
        track = ideal(run, bench, way, steps)
        if run.method is KALMAN:
            known, undecided = _filtered(run, bench, track)
        else:
            known, undecided = _estimated(run, bench, track, _sections(way, steps), way), ()
    except NotObserved as error:
        raise NotObserved(f"{run.path}: {error}", error.directions) from None
    except InputError as error:
        raise InputError(f"{run.path}: {error}") from None
    return PathSheet(run, _rows(way, steps), known, undecided)


def ideal(run: Run, bench: Turntable, way: Travel, steps: Sequence[TableStep]) -> Track:
    """Return the track of an ideal sensor on an ideal table, at the run's sampling rate.

    Parameters
    ----------
    run : Run
    bench : Turntable
    way : Travel
        Through the steps.
    steps : sequence of Position or Rotation
    """
    rate = run.rate_hz or _RATE
    time = np.arange(int(way.ends[-1] * rate) + 1) / rate
    angles, rates, accelerations = way.at(time)
    made = motion(bench, angles, rates, accelerations, {})
    reading = run.sensor.forward(made, np.zeros(len(run.sensor.coefficients)))
    section = np.searchsorted(way.ends, time)
    held = [k for k, k_step in enumerate(_sections(way, steps)) if isinstance(k_step, Position)]
    begun = time - np.append(0.0, way.ends)[section] >= _FIRST * (section > 0)
    hold = np.where(np.isin(section, held) & begun, section, -1)
    return Track(time, reading, angles, hold)


def _sections(way: Travel, steps: Sequence[TableStep]) -> list[TableStep | None]:
    """Return the step of each section of the way; None of a move between steps."""
    following = iter(steps)
    return [next(following) if label else None for label in way.labels]


def _rows(way: Travel, steps: Sequence[TableStep]) -> tuple[Step, ...]:
    rows: list[Step] = []
    move = 0.0
    for step, seconds in zip(_sections(way, steps), np.diff(way.ends, prepend=0.0), strict=True):
        if step is None:
            move = float(seconds)
        else:
            rows.append(Step(len(rows) + 1, step, move, float(seconds)))
            move = 0.0
    return tuple(rows)


def _filtered(
    run: Run, bench: Turntable, track: Track
) -> tuple[tuple[ExpectedUncertainty, ...], tuple[str, ...]]:
    """Return how well each coefficient will be known, and the directions that are left open."""
    way = follow.WAYS[run.estimator]
    found: dict[str, float] = {}
    undecided: list[str] = []
    for kind in KINDS:
        filtered = follow.filtered(kind, run.sensor, bench, track, way, run.priors)
        names = filtered.part.sensor.coefficients
        p = len(names)
        covariance = filtered.covariance[:p, :p]
        std = np.sqrt(np.diagonal(covariance))
        # What is left as it was guessed is no result.
        std = np.where(std < _OPEN * model.expected(filtered.part), std, np.nan)
        found |= dict(zip(names, std.tolist(), strict=True))
        undecided += [free.words for free in model.undecided(filtered.part, covariance)]
    return of_coefficients(run.sensor, found), tuple(undecided)


def _estimated(
    run: Run, bench: Turntable, track: Track, sections: Sequence[TableStep | None], way: Travel
) -> tuple[ExpectedUncertainty, ...]:
    """Return how well each coefficient will be known by an estimator of the whole path at once."""
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
    return alone(estimate, run.sensor)

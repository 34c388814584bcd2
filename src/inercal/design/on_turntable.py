"""The path of a turntable before it is run: its steps, how long it takes, what it will give.

The covariance of a Kalman filter does not depend on the noise that is drawn, and hardly on the
sensor: both filters run over the path as an ideal sensor would record it on an ideal table, with
noise and table as stated.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from inercal.benches import Turntable
from inercal.benches.turntable_attitude import motion
from inercal.benches.turntable_run import Travel, travel
from inercal.design.known import Known
from inercal.errors import InputError
from inercal.methods.turntable import model
from inercal.methods.turntable_kalman import follow
from inercal.plan import Position, Rotation, TableStep
from inercal.recording import Track
from inercal.runfile import Run

_RATE = 100.0  # Hz
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
    expected : tuple of Known
        Of each coefficient; of what is undecided that is a guess.
    undecided : tuple of str
        Directions of the coefficients that the path leaves open, in words.
    """

    run: Run
    rows: tuple[Step, ...]
    expected: tuple[Known, ...]
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
    """
    bench = run.bench
    if not isinstance(bench, Turntable):
        raise InputError(f"{run.path}: this plan is of a turntable")
    steps = [step for step in run.steps if isinstance(step, Position | Rotation)]
    try:
        way = travel(bench, steps)
        known, undecided = _known(run, bench, ideal(run, bench, way, steps))
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


def _known(run: Run, bench: Turntable, track: Track) -> tuple[tuple[Known, ...], tuple[str, ...]]:
    """Return how well each coefficient will be known, and the directions that are left open."""
    way = follow.WAYS[run.estimator]
    found: dict[str, float] = {}
    undecided: list[str] = []
    for one in (follow.gyros, follow.accelerometers):
        filtered = one(run.sensor, bench, track, way, run.priors)
        names = filtered.part.sensor.coefficients
        p = len(names)
        covariance = filtered.covariance[:p, :p]
        found |= dict(zip(names, np.sqrt(np.diagonal(covariance)).tolist(), strict=True))
        undecided += [free.words for free in model.undecided(filtered.part, covariance)]
    lines = [(name, run.sensor.coefficient(name)) for name in run.sensor.coefficients]
    known = (Known(name, line.meaning, line.unit, line.si, found[name]) for name, line in lines)
    return tuple(known), tuple(undecided)

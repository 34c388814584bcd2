"""Search for a better turntable path for a calibration by navigation, within a given time.

A path is a sequence of quarter turns about level axes of a three-axis table, within its limits. The
middle axis is always level. The inner axis is level when the middle axis is at 0° or 180°. The
search starts from the path that the run file names. It extends or shortens this path to the given
time and tries several lengths of the rests. It then replaces turns at random. A change is kept if
the mean of ln u of the coefficients decreases (D-optimality without the correlations).

Source: Fedorov 1972, Theory of Optimal Experiments (exchange algorithm).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import exp, inf, log, radians

import numpy as np

from inercal.basics.errors import InputError, NotObserved
from inercal.benches.turntable import Turntable, is_turntable
from inercal.benches.turntable.paths import quarter_turn_path, systematic_path
from inercal.benches.turntable.simulation import turntable_path_duration
from inercal.physics.plan import Position, TableStep
from inercal.physics.section_settings import key_error
from inercal.pipeline.design.turntable_path import path_uncertainties
from inercal.runfile import Run

_REST_SECONDS = (20.0, 30.0, 40.0, 60.0)
_LEAST_RESTS = 9
_RATE = 10.0  # Hz, sampling rate when plans are judged
_QUARTERS = 4
_ONLY = "only paths for method systematic on a three-axis table can be optimised"
_MIDDLE, _INNER = 1, 2

Turn = tuple[int, int]
"""The axis and the direction of a quarter turn: +1 or −1."""


@dataclass(frozen=True)
class FoundPath:
    """The best path that a search found.

    Parameters
    ----------
    steps : tuple of Position
    ratio : float
        Ratio of u with this path to u with the path of the run file: the geometric mean over all
        coefficients. It is zero if the path of the run file does not determine all coefficients.
    tried : int
        Number of paths that were judged.
    """

    steps: tuple[Position, ...]
    ratio: float
    tried: int


def search_path(
    run: Run, seconds: float, trials: int, seed: int, progress: Callable[[int], None]
) -> FoundPath:
    """Search for the best path that takes at most the given time.

    Parameters
    ----------
    run : Run
        Run with a method that does not use the table's angles.
    seconds : float
        Duration of the path, including its turns.
    trials : int
        Number of paths to judge.
    seed : int
    progress : callable
        Function called with the number of judged paths.

    Raises
    ------
    InputError
        If the run has another method, if the table does not have three axes, or if the time is too
        short.
    NotObserved
        If no path determines all coefficients.
    """
    if not is_turntable(run.bench):
        raise key_error("--optimise", f"a bench of kind {run.kind.name} has no path; {_ONLY}")
    bench = run.bench
    if not run.method.without_angles or len(bench.names) != len("xyz"):
        here = f"method {run.method.name} on a table with axes {bench.axes}"
        raise key_error("--optimise", f"{here}: {_ONLY}")
    rng = np.random.default_rng(seed)
    found = [
        (_cost(run, steps), rest, turns)
        for rest in _REST_SECONDS
        if (turns := _longest(bench, rest, seconds)) is not None
        for steps in (_steps(turns, rest),)
    ]
    if not found:
        raise key_error(
            "--optimise",
            f"{seconds:.0f} s is too short for {_LEAST_RESTS} rests of {_REST_SECONDS[0]:g} s with "
            "their turns; give more time",
        )
    best, rest, turns = min(found, key=lambda one: one[0])
    for tried in range(len(found), trials):
        progress(tried)
        changed = _exchanged(turns, rng)
        steps = _steps(changed, rest)
        if turntable_path_duration(bench, steps) > seconds:
            continue
        cost = _cost(run, steps)
        if cost < best:
            best, turns = cost, changed
    if best == inf:
        raise NotObserved(
            "none of the paths that were tried determines all coefficients", (), names=()
        )
    before = _cost(run, run.table_steps)
    return FoundPath(_steps(turns, rest), exp(best - before), trials)


def _cost(run: Run, steps: Sequence[TableStep]) -> float:
    """Return the mean of ln u; infinite if the path does not determine all coefficients."""
    try:
        expected, _ = path_uncertainties(run, steps, _RATE)
    except (InputError, NotObserved):
        return inf
    return float(np.mean([log(one.std) if one.std > 0 else inf for one in expected]))


def _longest(bench: Turntable, rest: float, seconds: float) -> list[Turn] | None:
    """Return the turns of the named path, repeated to fill the time; None if too few fit."""
    named = _turns_of(systematic_path(rest))
    turns = list(named)
    while turntable_path_duration(bench, _steps(turns, rest)) <= seconds:
        turns.append(named[len(turns) % len(named)])
        turns = _legal(turns)
    while turns and turntable_path_duration(bench, _steps(turns, rest)) > seconds:
        turns.pop()
    return turns if len(turns) + 1 >= _LEAST_RESTS else None


def _turns_of(steps: Sequence[TableStep]) -> list[Turn]:
    attitudes = [one.angles for one in steps if isinstance(one, Position)]
    quarters = np.rint(np.array(attitudes) / radians(90)).astype(int)
    result: list[Turn] = []
    for change in np.diff(quarters, axis=0).tolist():
        axis = _MIDDLE if change[_MIDDLE] else _INNER
        result.append((axis, change[axis]))
    return result


def _legal(turns: Sequence[Turn]) -> list[Turn]:
    """Adjust turns to keep both axes within 0° to 270° and to give each turn a level axis."""
    at, result = {_MIDDLE: 0, _INNER: 0}, list[Turn]()
    for wanted, way in turns:
        axis = _MIDDLE if at[_MIDDLE] % 2 else wanted
        way = way if 0 <= at[axis] + way < _QUARTERS else -way
        at[axis] += way
        result.append((axis, way))
    return result


def _exchanged(turns: Sequence[Turn], rng: np.random.Generator) -> list[Turn]:
    """Return the turns after one or two of them were replaced at random."""
    result = list(turns)
    for k in rng.integers(len(result), size=rng.integers(1, 3)).tolist():
        result[k] = (int(rng.choice([_MIDDLE, _INNER])), int(rng.choice([-1, 1])))
    return _legal(result)


def _steps(turns: Sequence[Turn], rest: float) -> tuple[Position, ...]:
    at = {_MIDDLE: 0, _INNER: 0}
    attitudes = [(0, 0, 0)]
    for axis, way in turns:
        at[axis] += way
        attitudes.append((0, at[_MIDDLE], at[_INNER]))
    return quarter_turn_path(attitudes, rest)


def path_table(steps: Sequence[Position], names: Sequence[str]) -> str:
    """Return a path of positions as text for a file that [method] `path` names."""
    head = ["label", "kind", *(f"{name} [°]" for name in names), "seconds [s]"]
    rows = [
        [one.label, "position", *(f"{np.degrees(a):.10g}" for a in one.angles), f"{one.seconds:g}"]
        for one in steps
    ]
    return "".join(",".join(row) + "\n" for row in [head, *rows])


def with_path(run: Run, steps: Sequence[Position]) -> Run:
    """Return the run with another path."""
    fixed = tuple(steps)
    return replace(run, plan=lambda: fixed, has_plan_keys=True)

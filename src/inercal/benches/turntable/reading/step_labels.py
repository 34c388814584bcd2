"""What the steps of a turntable's recording are called: by its labels, its plan, or in order."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from math import pi, radians

from inercal.benches.turntable.settings import TurntableData
from inercal.data import Source
from inercal.errors import InputError
from inercal.plan import Position, Rotation, TableStep, table_steps

_NEAR = radians(1)  # of a planned angle
_SHARE = 0.05  # of a planned turn


def label_steps(
    steps: Sequence[TableStep], own: Sequence[str] | None, run: Source[TurntableData]
) -> tuple[TableStep, ...]:
    """Return the steps with their names, each once.

    Parameters
    ----------
    steps : sequence of Position or Rotation
        As found, without names.
    own : sequence of str or None
        What the recording calls each; "" is nothing.
    run : Source
        Its plan gives the names where it is what was done.
    """
    names = [name.strip() for name in own] if own is not None else [""] * len(steps)
    if not any(names):
        names = _planned_names(steps, run) or names
    count: Counter[str] = Counter()
    result: list[TableStep] = []
    for step, name in zip(steps, names, strict=True):
        kind = "hold" if isinstance(step, Position) else "turn"
        given = name or kind
        count[given] += 1
        numbered = f"{given} {count[given]}" if not name else f"{given} ({count[given]})"
        result.append(replace(step, label=name if name and count[name] == 1 else numbered))
    return tuple(result)


def _planned_names(steps: Sequence[TableStep], run: Source[TurntableData]) -> list[str] | None:
    """Return the plan's names, if it is what was done."""
    try:
        plan = merge_positions(table_steps(run.steps))
    except InputError:
        return None  # a recording is calibrated without a plan
    if len(plan) != len(steps):
        return None
    fits = all(steps_match(done, requested) for done, requested in zip(steps, plan, strict=True))
    return [step.label for step in plan] if fits else None


def merge_positions(plan: Sequence[TableStep]) -> list[TableStep]:
    """Return the plan with neighbouring positions at the same angles as one."""
    found: list[TableStep] = []
    for step in plan:
        before = found[-1] if found else None
        if (
            isinstance(step, Position)
            and isinstance(before, Position)
            and steps_match(before, step)
        ):
            found[-1] = replace(before, label=f"{before.label}, {step.label}")
        else:
            found.append(step)
    return found


def steps_match(done: TableStep, asked: TableStep) -> bool:
    """Return whether a step that was found is the one that was asked for."""
    if isinstance(done, Position) and isinstance(asked, Position):
        pairs = zip(done.angles, asked.angles, strict=True)
        return all(abs(pi - (pi - (a - b)) % (2 * pi)) < _NEAR for a, b in pairs)
    if isinstance(done, Rotation) and isinstance(asked, Rotation):
        return done.axis == asked.axis and abs(done.angle / asked.angle - 1) < _SHARE
    return False

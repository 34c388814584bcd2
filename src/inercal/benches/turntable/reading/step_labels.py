"""Label the steps of a turntable's recording, and compare the steps with the plan.

The labels come from the recording, otherwise from the plan, otherwise they are numbers in order.
"""

from collections import Counter
from collections.abc import Container, Sequence
from dataclasses import replace
from math import pi, radians

from inercal.basics.errors import InputError
from inercal.basics.units import format_count
from inercal.benches.turntable.settings import TurntableData
from inercal.physics.plan import Position, Rotation, TableStep, table_steps
from inercal.recordings import Finding
from inercal.recordings.data import RunBase

_NEAR = radians(1)  # tolerance of a planned angle
_TURN_TOLERANCE = 0.05  # relative tolerance of a planned turn
_NAMED = 6  # most labels that are named
_SHARE = 0.5  # fraction of the steps: if fewer agree, the recording is of another path


def label_steps(
    steps: Sequence[TableStep], own: Sequence[str] | None, run: RunBase[TurntableData]
) -> tuple[TableStep, ...]:
    """Return the steps with unique labels.

    Parameters
    ----------
    steps : sequence of Position or Rotation
        Steps found in the recording, without labels.
    own : sequence of str or None
        The recording's label of each step; "" means no label.
    run : RunBase
        The run, whose plan gives the labels if its steps match the recording.
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


def _planned_names(steps: Sequence[TableStep], run: RunBase[TurntableData]) -> list[str] | None:
    """Return the labels of the plan if its steps match the recording."""
    plan = _merge_positions(_planned_steps(run) or [])
    fits = len(plan) == len(steps) and all(map(_steps_match, steps, plan))
    return [step.label for step in plan] if fits else None


def _planned_steps(run: RunBase[TurntableData]) -> list[TableStep] | None:
    """Return the plan, or None if it is refused, because a calibration does not need it."""
    try:
        return table_steps(run.steps)
    except InputError:
        return None


def _merge_positions(plan: Sequence[TableStep]) -> list[TableStep]:
    """Return the plan with consecutive positions at the same angles merged into one."""
    merged: list[TableStep] = []
    for step in plan:
        if merged and isinstance(step, Position) and _steps_match(merged[-1], step):
            merged[-1] = replace(merged[-1], label=f"{merged[-1].label}, {step.label}")
        else:
            merged.append(step)
    return merged


def _steps_match(done: TableStep, planned: TableStep) -> bool:
    """Return whether a step of the recording agrees with the planned step."""
    if isinstance(done, Position) and isinstance(planned, Position):
        pairs = zip(done.angles, planned.angles, strict=True)
        return all(abs(pi - (pi - (a - b)) % (2 * pi)) < _NEAR for a, b in pairs)
    if isinstance(done, Rotation) and isinstance(planned, Rotation):
        return done.axis == planned.axis and abs(done.angle / planned.angle - 1) < _TURN_TOLERANCE
    return False


def compare_with_plan(
    steps: Sequence[TableStep],
    own: Sequence[str] | None,
    run: RunBase[TurntableData],
    repeated: Container[str] = (),
) -> tuple[Finding, ...]:
    """Return warnings about missing steps, and about labels that are blank or wrong.

    Parameters
    ----------
    steps : sequence of Position or Rotation
        Steps found in the recording, with labels.
    own : sequence of str or None
        The recording's label of each step; "" means no label.
    run : RunBase
        The run. If [method] states no path, nothing is compared.
    repeated : container of str
        Labels of steps that have no label in the recording because they were repeated.
    """
    plan = _planned_steps(run) if run.has_plan_keys else None
    if plan is None:
        return ()
    labels = [name.strip() for name in own] if own is not None else []
    if any(labels):
        return _compare_labels(steps, labels, plan, repeated)
    planned = _merge_positions(plan)
    missing = list(planned)
    for step in steps:
        k = next((k for k, other in enumerate(missing) if _steps_match(step, other)), None)
        if k is not None:
            del missing[k]
    if len(missing) > (1 - _SHARE) * len(planned):
        return (_other_path_finding(len(planned) - len(missing), len(planned)),)
    return _missing_step_findings([step.label for step in missing])


def _compare_labels(
    steps: Sequence[TableStep],
    labels: Sequence[str],
    plan: Sequence[TableStep],
    repeated: Container[str],
) -> tuple[Finding, ...]:
    planned = {step.label: step for step in plan}
    known = [name for name in labels if name in planned]
    if len(set(known)) < (1 - _SHARE) * len(planned) and len(known) < len(labels) * _SHARE:
        return (_other_path_finding(len(set(known)), len(planned)),)
    texts: list[str] = []
    for step, name in zip(steps, labels, strict=True):
        if name in planned and not _steps_match(step, planned[name]):
            text = f"{name}: the recording has {step.describe()}, the plan has "
            texts.append(f"{text}{planned[name].describe()}; check the labels".replace("-", "−"))
    without = [step.label for step, name in zip(steps, labels, strict=True) if not name]
    blank = [name for name in without if name not in repeated]
    unknown = [name for name in dict.fromkeys(labels) if name and name not in planned]
    for names, words in ((blank, "without a label"), (unknown, "with a label not in the path")):
        if names:
            count = format_count(len(names), "step")
            texts.append(f"{count} {words}: {_abbreviated_list(names)}")
    missing = _missing_step_findings([name for name in planned if name not in labels])
    return (*missing, *(Finding("warning", "label", text) for text in texts))


def _missing_step_findings(names: Sequence[str]) -> tuple[Finding, ...]:
    if not names:
        return ()
    text = f"steps of the path are missing in the recording: {_abbreviated_list(names)}"
    return (Finding("warning", "path", f"{text}; check whether it was cut"),)


def _other_path_finding(count: int, of: int) -> Finding:
    text = f"the recording has only {count} of the {of} steps in [method] path"
    return Finding("warning", "path", f"{text}; check whether it is a recording of another path")


def _abbreviated_list(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more

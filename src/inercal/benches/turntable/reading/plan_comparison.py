"""What a recording on a turntable lacks of the path that its run file names, and has otherwise."""

from collections.abc import Sequence

from inercal.benches.turntable.reading.step_labels import merge_positions, steps_match
from inercal.benches.turntable.settings import TurntableData
from inercal.data import Source
from inercal.errors import InputError
from inercal.plan import TableStep, table_steps
from inercal.recording import Finding

_NAMED = 6  # labels
_SHARE = 0.5  # of the steps: fewer as planned, and it is another path


def compare_with_plan(
    steps: Sequence[TableStep], own: Sequence[str] | None, run: Source[TurntableData]
) -> tuple[Finding, ...]:
    """Return warnings of steps that are missing, and of labels that are blank or another step's.

    Parameters
    ----------
    steps : sequence of Position or Rotation
        As found, labelled.
    own : sequence of str or None
        What the recording calls each; "" is nothing.
    run : Source
        Without a path in [method] nothing is compared.
    """
    if not run.has_plan_keys:
        return ()
    try:
        plan = table_steps(run.steps)
    except InputError:
        return ()  # a recording is calibrated without a plan
    labels = [name.strip() for name in own] if own is not None else []
    if any(labels):
        return _compare_labels(steps, labels, plan)
    wanted = merge_positions(plan)
    left = list(wanted)
    for step in steps:
        for k, requested in enumerate(left):
            if steps_match(step, requested):
                del left[k]
                break
    if len(left) > (1 - _SHARE) * len(wanted):
        return (_other_path_finding(len(wanted) - len(left), len(wanted)),)
    return _missing_step_findings([step.label for step in left])


def _compare_labels(
    steps: Sequence[TableStep], labels: Sequence[str], plan: Sequence[TableStep]
) -> tuple[Finding, ...]:
    requested = {step.label: step for step in plan}
    known = [name for name in labels if name in requested]
    if len(set(known)) < (1 - _SHARE) * len(requested) and len(known) < len(labels) * _SHARE:
        return (_other_path_finding(len(set(known)), len(requested)),)
    found = list(_missing_step_findings([name for name in requested if name not in labels]))
    for step, name in zip(steps, labels, strict=True):
        if name in requested and not steps_match(step, requested[name]):
            text = f"{name}: {step.describe()}, and by its plan {requested[name].describe()}"
            text += ": look at the labels"
            found.append(Finding("warning", "label", text.replace("-", "−")))
    blank = [step.label for step, name in zip(steps, labels, strict=True) if not name]
    strange = [name for name in dict.fromkeys(labels) if name and name not in requested]
    for names, words in ((blank, "without a label"), (strange, "of no step of the path")):
        if names:
            count = f"{len(names)} step{'s' * (len(names) > 1)}"
            found.append(
                Finding("warning", "label", f"{count} {words}: {_abbreviated_list(names)}")
            )
    return tuple(found)


def _missing_step_findings(names: Sequence[str]) -> tuple[Finding, ...]:
    if not names:
        return ()
    text = f"of the path, {_abbreviated_list(names)} {'are' if len(names) > 1 else 'is'} missing"
    return (Finding("warning", "path", f"{text}: was the recording cut?"),)


def _other_path_finding(count: int, of: int) -> Finding:
    text = f"{count} of the {of} steps of [method] path are in the recording: is it another path's?"
    return Finding("warning", "path", text)


def _abbreviated_list(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more

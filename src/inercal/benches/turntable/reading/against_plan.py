"""What a recording on a turntable lacks of the path that its run file names, and has otherwise."""

from collections.abc import Sequence

from inercal.benches.turntable.reading.labels import alike, merged
from inercal.benches.turntable.settings import TurntableData
from inercal.data import Source
from inercal.errors import InputError
from inercal.plan import TableStep, table_steps
from inercal.recording import Finding

_NAMED = 6  # labels
_SHARE = 0.5  # of the steps: fewer as planned, and it is another path


def against_plan(
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
    if not run.planned:
        return ()
    try:
        plan = table_steps(run.steps)
    except InputError:
        return ()  # a recording is calibrated without a plan
    labels = [name.strip() for name in own] if own is not None else []
    if any(labels):
        return _by_label(steps, labels, plan)
    wanted = merged(plan)
    left = list(wanted)
    for step in steps:
        for k, asked in enumerate(left):
            if alike(step, asked):
                del left[k]
                break
    if len(left) > (1 - _SHARE) * len(wanted):
        return (_other(len(wanted) - len(left), len(wanted)),)
    return _missing([step.label for step in left])


def _by_label(
    steps: Sequence[TableStep], labels: Sequence[str], plan: Sequence[TableStep]
) -> tuple[Finding, ...]:
    asked = {step.label: step for step in plan}
    known = [name for name in labels if name in asked]
    if len(set(known)) < (1 - _SHARE) * len(asked) and len(known) < len(labels) * _SHARE:
        return (_other(len(set(known)), len(asked)),)
    found = list(_missing([name for name in asked if name not in labels]))
    for step, name in zip(steps, labels, strict=True):
        if name in asked and not alike(step, asked[name]):
            text = f"{name}: {step.in_words()}, and by its plan {asked[name].in_words()}"
            text += ": look at the labels"
            found.append(Finding("warning", "label", text.replace("-", "−")))
    blank = [step.label for step, name in zip(steps, labels, strict=True) if not name]
    strange = [name for name in dict.fromkeys(labels) if name and name not in asked]
    for names, words in ((blank, "without a label"), (strange, "of no step of the path")):
        if names:
            count = f"{len(names)} step{'s' * (len(names) > 1)}"
            found.append(Finding("warning", "label", f"{count} {words}: {_listed(names)}"))
    return tuple(found)


def _missing(names: Sequence[str]) -> tuple[Finding, ...]:
    if not names:
        return ()
    text = f"of the path, {_listed(names)} {'are' if len(names) > 1 else 'is'} missing"
    return (Finding("warning", "path", f"{text}: was the recording cut?"),)


def _other(count: int, of: int) -> Finding:
    text = f"{count} of the {of} steps of [method] path are in the recording: is it another path's?"
    return Finding("warning", "path", text)


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more

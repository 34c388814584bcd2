"""What a budget asks of a plan: each step is one mean reading whose motion is known."""

from collections.abc import Sequence

from inercal.benches import Bench, MeanBench
from inercal.benches.kinds import kind_for_bench
from inercal.errors import InputError
from inercal.plan import Spin, Step


def require_budget_plan(bench: Bench, steps: Sequence[Step]) -> MeanBench:
    """Return the bench; refuse a plan that does not say what the sensor feels.

    Raises
    ------
    InputError
        No steps, steps of another bench, attitudes on the arm that are not known, or what the kind
        of bench says.
    """
    kind = kind_for_bench(bench)
    if steps and not all(isinstance(step, kind.steps) for step in steps):
        raise InputError("the plan's steps are for another bench than the one that is stated")
    if reason := kind.refuses_budget(bench, steps):
        raise InputError(reason)
    if not isinstance(bench, MeanBench):
        raise InputError(f"a budget is of means, which a bench of kind {kind.name} does not have")
    if not steps:
        raise InputError("a budget needs a plan; this one has no steps")
    if any(isinstance(step, Spin) and step.attitude is None for step in steps):
        raise InputError(
            "a budget needs a plan with attitudes ([method] attitudes and rates): a table of means "
            "does not say in which ones it was taken"
        )
    return bench

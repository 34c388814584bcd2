"""Check that a plan suits a budget: each step must be a mean reading at a known motion."""

from collections.abc import Sequence

from inercal.basics.errors import InputError
from inercal.benches import Bench, MeanBench
from inercal.benches.kinds import kind_for_bench
from inercal.physics.plan import Spin, Step


def require_budget_plan(bench: Bench, steps: Sequence[Step]) -> MeanBench:
    """Return the bench; raise an error if the plan does not define the motion of the sensor.

    Raises
    ------
    InputError
        If there are no steps, if the steps are for another bench, if attitudes on the arm are
        unknown, or if this kind of bench does not accept the plan.
    """
    kind = kind_for_bench(bench)
    if steps and not all(isinstance(step, kind.steps) for step in steps):
        raise InputError(
            f"the steps of the plan are for another bench than {kind.name}; change [bench] kind or "
            "the plan",
            key="[bench] kind",
        )
    if reason := kind.refuses_budget(bench, steps):
        raise InputError(reason)
    if not isinstance(bench, MeanBench):
        raise InputError(
            f"a budget needs mean readings, which a bench of kind {kind.name} does not provide; "
            "use another bench",
            key="[bench] kind",
        )
    if not steps:
        raise InputError("a budget needs a plan with steps; add steps", key="steps")
    if any(isinstance(step, Spin) and step.attitude is None for step in steps):
        raise InputError(
            "a budget needs a plan with attitudes, but a table of means does not state attitudes; "
            "state [method] attitudes and rates",
            key="[method] attitudes",
        )
    return bench

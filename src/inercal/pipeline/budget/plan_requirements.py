"""Requirements of a budget on a plan: each step is one mean reading of known motion."""

from collections.abc import Sequence

from inercal.basics.errors import InputError
from inercal.benches import Bench, MeanBench
from inercal.benches.kinds import kind_for_bench
from inercal.physics.plan import Spin, Step


def require_budget_plan(bench: Bench, steps: Sequence[Step]) -> MeanBench:
    """Return the bench; refuse a plan that does not determine the motion of the sensor.

    Raises
    ------
    InputError
        No steps, steps of another bench, unknown attitudes on the arm, or a refusal by the kind of
        bench.
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
            f"a bench of kind {kind.name} has no mean readings, which a budget needs; use another "
            "bench",
            key="[bench] kind",
        )
    if not steps:
        raise InputError("a budget needs a plan with steps; add steps", key="steps")
    if any(isinstance(step, Spin) and step.attitude is None for step in steps):
        raise InputError(
            "a budget needs a plan with attitudes, and a table of means states no attitudes; state "
            "[method] attitudes and rates",
            key="[method] attitudes",
        )
    return bench

"""What a budget asks of a plan: each step is one mean reading whose motion is known."""

from collections.abc import Mapping, Sequence

from inercal.benches import Bench, Centrifuge, DividingHead, Hand, MeanBench, RateTable
from inercal.errors import InputError
from inercal.plan import Hold, Index, Spin, Step, Turn

_STEPS: Mapping[type, tuple[type, ...]] = {
    Hand: (Hold, Turn),
    Centrifuge: (Spin,),
    DividingHead: (Index,),
    RateTable: (Spin,),
}


def require_possible(bench: Bench, steps: Sequence[Step]) -> MeanBench:
    """Return the bench; refuse a plan that does not say what the sensor feels.

    Raises
    ------
    InputError
        No steps, steps of another bench, or attitudes on the arm that are not known.
    """
    if not isinstance(bench, MeanBench):
        raise InputError(
            "a budget is of means, and a turntable's filters follow every sample: inercal plan "
            "turntable-kalman says what a path gives"
        )
    if not steps:
        raise InputError("a budget needs a plan; this one has no steps")
    kinds = _STEPS.get(type(bench))
    if kinds is not None and not all(isinstance(step, kinds) for step in steps):
        raise InputError("the plan's steps are for another bench than the one that is stated")
    if isinstance(bench, Centrifuge) and bench.platform != "locked":
        raise InputError(
            "a budget of a counter-rotating platform is not there: simulate its runs instead"
        )
    if any(isinstance(step, Spin) and step.attitude is None for step in steps):
        raise InputError(
            "a budget needs a plan with attitudes ([method] attitudes and rates): a table of means "
            "does not say in which ones it was taken"
        )
    return bench

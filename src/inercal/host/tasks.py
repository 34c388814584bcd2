"""A plan as the table carries it out: its tasks, and what may be asked of the bench of a run."""

from typing import Any, NamedTuple

from inercal.benches.driven_bench import DrivenBench, DrivenKind, SpinTask, Task, TurnTask
from inercal.benches.kinds import require_driven
from inercal.runfile import Run


class DrivenPlan(NamedTuple):
    """What a host drives of a run file."""

    bench: DrivenBench
    kind: DrivenKind
    tasks: tuple[Task, ...]

    @property
    def seconds(self) -> float:
        """How long all tasks take, s, without the time of an operator."""
        return sum(one.approach + one.seconds for one in self.tasks)

    @property
    def spins(self) -> bool:
        """The table turns at rates, with mountings that an operator changes."""
        return self.kind.quantity == "rate"


def driven_plan(run: Run) -> DrivenPlan:
    """Return what a host drives of a run file.

    Raises
    ------
    InputError
        A bench that no host drives, or a plan that it cannot carry out.
    """
    kind, bench = require_driven(run), run.bench
    driven: Any = bench  # the kind states that its benches have axes
    return DrivenPlan(driven, kind, tuple(kind.tasks(bench, run.steps)))


__all__ = ["DrivenPlan", "SpinTask", "Task", "TurnTask", "driven_plan"]

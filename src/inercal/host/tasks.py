"""The tasks of a plan, with the bench that carries them out."""

from typing import Any, NamedTuple

from inercal.benches.kinds import require_motion_control
from inercal.benches.motion_control import ControlledBench, MotionControl, SpinTask, Task, TurnTask
from inercal.runfile import Run


class HostPlan(NamedTuple):
    """What a host drives of a run file."""

    bench: ControlledBench
    kind: MotionControl
    tasks: tuple[Task, ...]

    @property
    def seconds(self) -> float:
        """How long all tasks take, s, without the time of an operator."""
        return sum(one.approach + one.seconds for one in self.tasks)

    @property
    def spins(self) -> bool:
        """The table turns at rates, with mountings that an operator changes."""
        return self.kind.quantity == "rate"


def host_plan(run: Run) -> HostPlan:
    """Return what a host drives of a run file.

    Raises
    ------
    InputError
        A bench that no host drives, or a plan that it cannot carry out.
    """
    kind, bench = require_motion_control(run), run.bench
    controlled: Any = bench  # the kind states that its benches have axes
    return HostPlan(controlled, kind, tuple(kind.tasks(bench, run.steps)))


__all__ = ["HostPlan", "SpinTask", "Task", "TurnTask", "host_plan"]

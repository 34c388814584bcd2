"""The tasks of a plan, with the bench that carries them out, and the options of its operator."""

from typing import Any, NamedTuple

from inercal.basics.errors import InputError
from inercal.benches.motion_control import ControlledBench, MotionControl, Task
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
    kind, bench = run.motion_control, run.bench
    controlled: Any = bench  # the kind states that its benches have axes
    return HostPlan(controlled, kind, tuple(kind.tasks(bench, run.steps)))


def required_rate(run: Run) -> float:
    """Return the sampling rate of a run file, Hz; raises `InputError` where it states none."""
    if run.rate_hz is None:
        raise InputError(
            f'{run.path}: [data] rate is missing; add it, such as rate = "200 Hz"',
            file=run.path,
            key="[data] rate",
        )
    return run.rate_hz


class RunOptions(NamedTuple):
    """Options of a run that the operator sets when it starts; the run file has all others.

    Parameters
    ----------
    speed : float or None
        Largest number of seconds that a simulated bench advances per second; None: no limit.
    temperature : (float, float) or None
        Lowest and highest temperature of the IMU, K; outside them the run pauses.
    patience : float
        Time without data of the IMU after which the run ends, s.
    """

    speed: float | None = None
    temperature: tuple[float, float] | None = None
    patience: float = 120.0


DEFAULT_OPTIONS = RunOptions()

"""The tasks of a plan, the bench that carries them out, and the operator's options."""

from typing import Any, NamedTuple

from inercal.basics.errors import InputError
from inercal.benches.motion_control import ControlledBench, Task
from inercal.runfile import Run


class HostPlan(NamedTuple):
    """The bench and the tasks of all soaks; if the table spins, an operator mounts the sensor."""

    bench: ControlledBench
    tasks: tuple[Task, ...]
    spins: bool

    @property
    def seconds(self) -> float:
        """Duration of all tasks, without the time that the operator needs, s."""
        return sum(one.approach + one.seconds for one in self.tasks)


def host_plan(run: Run) -> HostPlan:
    """Return the bench and the tasks that a host needs from a run file.

    Raises
    ------
    InputError
        No host can drive the bench, or the host cannot carry out the plan.
    """
    control = run.motion_control
    bench: Any = run.bench  # the kind of the bench guarantees that there are axes
    times = len(run.environment.soaks) if run.environment and has_soaks(run) else 1
    return HostPlan(
        bench, tuple(control.tasks(bench, run.steps)) * times, control.quantity == "rate"
    )


def has_soaks(run: Run) -> bool:
    """Return whether a host carries out the plan at several temperatures."""
    return run.environment is not None and bool(run.environment.soaks)


def required_rate(run: Run) -> float:
    """Return the sampling rate in a run file, Hz, or raise an `InputError` if it is missing."""
    if run.rate_hz is None:
        raise InputError(
            f'{run.path}: [data] rate is missing; add it, such as rate = "200 Hz"',
            file=run.path,
            key="[data] rate",
        )
    return run.rate_hz


class RunOptions(NamedTuple):
    """Options that the operator sets when a run starts; all other settings are in the run file.

    Parameters
    ----------
    speed : float or None
        Highest speed of a simulated bench, in bench seconds per second of wall time; None means no
        limit.
    temperature : (float, float) or None
        Lowest and highest permitted temperature of the IMU, K. Outside this range, the run pauses.
    patience : float
        Time without data from the IMU after which the run ends, s.
    """

    speed: float | None = None
    temperature: tuple[float, float] | None = None
    patience: float = 120.0


DEFAULT_OPTIONS = RunOptions()

"""Checks, before anything moves, that the method and the table both accept the plan."""

from collections.abc import Sequence
from dataclasses import replace

from inercal.basics.errors import InputError, NotObserved
from inercal.benches.motion_control import ControlledBench, SpinTask, Task
from inercal.benches.turntable import is_turntable
from inercal.benches.turntable.bench import COARSE_REST_SECONDS, settling_time
from inercal.host.drivers.rotary_table import AxisLimits
from inercal.host.packets import PacketLayout
from inercal.host.tasks import RunOptions
from inercal.physics.plan import Position
from inercal.pipeline.design.turntable_path import turntable_path_sheet
from inercal.runfile import Run

_REST_KEY = "hold"  # key of the error if the first rest is too short


def check_plan(run: Run) -> tuple[str, ...]:
    """Return warnings about a plan that a host is about to carry out.

    The method processes a recording of an ideal sensor on an ideal table. It may refuse these data
    for a reason that does not apply to a real recording, such as a temperature coefficient. Such a
    refusal says nothing about the plan.

    Parameters
    ----------
    run : Run

    Raises
    ------
    InputError
        The first rest is too short, so the method would refuse the recording.
    """
    if not is_turntable(run.bench):
        return ()
    first = next((step for step in run.steps if isinstance(step, Position)), None)
    left_out = 2 * settling_time(run.bench)  # omitted at the ends of a rest
    checked = run
    if first is not None and first.seconds > left_out:
        shorter = replace(first, seconds=first.seconds - left_out)
        steps = tuple(shorter if step is first else step for step in run.steps)
        checked = replace(run, plan=lambda: steps)
    try:
        sheet = turntable_path_sheet(checked)
    except NotObserved as error:
        return (f"the plan does not determine all coefficients: {error}",)
    except InputError as error:
        if error.key != _REST_KEY:
            return ()
        rest = "no rest" if first is None else f"{first.label}, a rest of {first.seconds:g} s"
        raise InputError(
            f"the first rest of the plan is {rest}, but the method needs "
            f"{COARSE_REST_SECONDS:g} s of rest for the first values of the biases: begin with a "
            "rest of this length or longer",
            key="[method] path",
            names=() if first is None else (first.label,),
        ).located(run.path) from None
    except Exception:
        # A method may come from another package. If it fails on an ideal path, the run must not
        # end.
        return ()
    undecided = "; ".join(sheet.undecided)
    lacking = f"the plan does not determine all coefficients: {undecided}" if undecided else ""
    return tuple(filter(None, (lacking, *sheet.warnings)))


def require_feasible_plan(
    tasks: Sequence[Task], limits: Sequence[AxisLimits], bench: ControlledBench
) -> None:
    """Raise an error if the controller would refuse the plan or nothing enforces a limit.

    Parameters
    ----------
    tasks : sequence of Task
    limits : sequence of AxisLimits
        Limits that are set in the controller.
    bench : ControlledBench

    Raises
    ------
    InputError
        An axis cannot execute the plan; the message names the axis.
    """
    names, held = bench.names, bench.axis_motion_limits
    for task in tasks:
        if isinstance(task, SpinTask):
            limits[0].check(names[0], task.rate, held[0].acceleration)
            continue
        for name, most, of, *angles in zip(names, limits, held, task.start, task.end, strict=True):
            for angle in angles:
                most.check(name, task.rate or of.rate, of.acceleration, angle)


def require_thermometer(options: RunOptions, layout: PacketLayout) -> None:
    """Raise an `InputError` if the temperature of an IMU is limited, but not in its packets."""
    if options.temperature is not None and "temperature" not in layout.roles:
        raise InputError(
            f"the packets of {layout.name} contain no temperature; leave --temperature out",
            key="--temperature",
            names=(layout.name,),
        )

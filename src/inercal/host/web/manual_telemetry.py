"""Tells the page of a session by hand how it stands, in the messages of a run.

The plan has no steps and no coefficients; `manual` in it has the limits of the axes, in ° and °/s,
and what the controller cannot do. In the state, `manual` has of each axis the set value and the
lamps.
"""

from math import degrees, nan, radians
from typing import Any

from inercal.host.drivers.rotary_table import AxisLimits, AxisState
from inercal.host.journal import Journal
from inercal.host.manual.command_check import LIMIT_MARGIN, AxisTask
from inercal.host.manual.session import ManualSession
from inercal.host.web.page_messages import (
    axis_fields,
    channel_fields,
    imu_fields,
    rounded_number,
)
from inercal.host.web.run_request import ManualRequest
from inercal.host.web.telemetry import Telemetry
from inercal.host.web.worker_process import Publisher
from inercal.runfile import Run

# rad from a soft limit at which its lamp is lit: where a jog toward it ends
_LAMP_MARGIN = LIMIT_MARGIN + radians(0.02)


class ManualTelemetry(Telemetry):
    """Tells of one session; called with it now and then.

    Parameters
    ----------
    order : ManualRequest
    run : Run
    publisher : Publisher
    journal : Journal
    """

    def __init__(self, order: ManualRequest, run: Run, publisher: Publisher, journal: Journal):
        super().__init__(publisher, journal)
        self._order, self._run = order, run

    def __call__(self, session: ManualSession) -> None:
        """Tell what is new."""
        self.publish_events()
        self._publish_samples(session.imu.take_received() if session.imu is not None else None)
        self._publisher.publish("state", **_state_message(session))

    def publish_plan(self, session: ManualSession) -> None:
        """Tell what is operated, within which limits."""
        order, sensor = self._order, self._run.sensor
        self._publisher.publish(
            "plan",
            run=order.name,
            sensor=sensor.name,
            plan=self._run.path.name,
            simulated=order.simulated is not None or bool(order.clock),
            seconds=0.0,
            axes=list(session.axes),
            channels=channel_fields(sensor.axes if session.imu is not None else ()),
            steps=[],
            coefficients=[],
            manual={
                "limits": [_limit_fields(one) for one in session.limits],
                "unsupported": dict(session.unsupported),
            },
        )


def _state_message(session: ManualSession) -> dict[str, Any]:
    state = session.state
    axes = () if state is None else state.axes
    return {
        "time": rounded_number(session.time),
        "phase": "manual",
        "paused": "",
        "trouble": (session.imu.trouble or "") if session.imu is not None else "",
        "done": 0,
        "remaining": None,
        "speed": 1.0,
        "table": None if state is None else {"axes": [axis_fields(axis) for axis in axes]},
        # No sample is kept; most have no angle, before the axes are homed.
        "imu": None if session.imu is None else imu_fields(session.imu.tally.bytes),
        "live": "none",
        "attitude": None,
        "manual": [
            _manual_fields(axis, limits, task)
            for axis, limits, task in zip(axes, session.limits, session.tasks, strict=False)
        ],
    }


def _limit_fields(limits: AxisLimits) -> dict[str, float | None]:
    return {
        "rate": rounded_number(degrees(limits.rate)),
        "low": rounded_number(degrees(limits.low)),
        "high": rounded_number(degrees(limits.high)),
    }


def _manual_fields(axis: AxisState, limits: AxisLimits, task: AxisTask) -> dict[str, Any]:
    """Return set values and lamps of an axis.

    The set angle is where it was sent; of one that was sent nowhere it is what the servo follows,
    the readback and the following error, where the controller tells that.
    """
    follows = axis.angle + axis.following_error if axis.enabled else nan
    is_sent = task.goal == task.goal and task.activity in ("go", "idle")
    return {
        "activity": task.activity,
        "set": rounded_number(degrees(task.goal if is_sent else follows), 9),
        "set_rate": rounded_number(degrees(task.rate)),
        "servo": axis.enabled,
        "homed": axis.homed,
        "in_position": axis.in_position,
        "moving": axis.moving,
        "low": axis.at_low or axis.angle <= limits.low + _LAMP_MARGIN,
        "high": axis.at_high or axis.angle >= limits.high - _LAMP_MARGIN,
        "fault": bool(axis.faults),
    }

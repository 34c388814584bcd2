"""Sends the changes in a run or a manual session to the page.

On an accelerated bench, means of several samples are sent, because a page cannot draw more than a
few hundred samples per second.

A manual session uses the same messages as a run. The plan message of a session has no steps and no
coefficients. Its field `manual` contains the limits of the axes in ° and °/s, and the functions
that the controller cannot carry out. In the state message, `manual` contains the set value and the
lamps of each axis.
"""

from collections import deque
from math import ceil, degrees, nan, radians
from time import monotonic
from typing import Any

import numpy as np

from inercal.basics.arrays import Array
from inercal.host.bench_run import BenchRun
from inercal.host.drivers.rotary_table import AxisLimits, AxisState
from inercal.host.journal import Journal
from inercal.host.live_estimator import LiveEstimator
from inercal.host.manual.commands import LIMIT_MARGIN, AxisTask
from inercal.host.manual.session import ManualSession
from inercal.host.web import page_messages
from inercal.host.web.page_messages import axis_fields, channel_fields, imu_fields, rounded_number
from inercal.host.web.run_request import ManualRequest
from inercal.host.web.worker_process import Publisher
from inercal.runfile import Run

UPDATE_INTERVAL = 0.1  # s of wall time between two updates
_ESTIMATE_INTERVAL = 0.5  # s of wall time
FINE_RATE, COARSE_RATE = 250.0, 10.0  # most samples per second of wall time for a viewer
_RATE_TOLERANCE = 1.2  # times the rate above which means are sent, because the rate varies
_INNOVATION_WINDOW = 30.0  # s of the recording; window in which innovations are evaluated
_MAX_EVENTS = 500  # largest number of earlier events sent when a run is resumed


class Telemetry:
    """Sends new journal events and new IMU samples to the page.

    Parameters
    ----------
    publisher : Publisher
    journal : Journal
    published_events : int
        Number of events that were already sent or are too old to be sent.
    """

    def __init__(self, publisher: Publisher, journal: Journal, published_events: int = 0):
        self._publisher, self._journal = publisher, journal
        self._published_events = published_events
        self._streams = {"coarse": MeanStream(COARSE_RATE), "samples": MeanStream(FINE_RATE)}

    def publish_events(self) -> None:
        """Publish the new events of the journal."""
        for event in self._journal.events(self._published_events):
            self._published_events += 1
            self._publisher.publish("event", n=self._published_events, **event._asdict())

    def _publish_samples(self, received: tuple[Array, Array] | None) -> None:
        if received is not None:
            for kind, stream in self._streams.items():
                if (means := stream.take(*received)) is not None:
                    self._publisher.publish(kind, **page_messages.samples_message(*means))


class RunTelemetry(Telemetry):
    """Publishes the state of a run at each call; all times are run times in s.

    Parameters
    ----------
    publisher : Publisher
    run : Run
        The run from the run file.
    journal : Journal
    """

    def __init__(self, publisher: Publisher, run: Run, journal: Journal):
        super().__init__(publisher, journal, max(0, len(journal.events()) - _MAX_EVENTS))
        self._plan, sensor = run, run.sensor
        self._unit_sizes = np.array([sensor.coefficient(name).si for name in sensor.coefficients])
        self._angles: Array | None = None
        self._estimates_published_at = monotonic()
        self._estimates_time: float = nan
        self._innovations: deque[tuple[float, dict[str, tuple[float, int]]]] = deque()

    def __call__(self, run: BenchRun) -> None:
        """Publish all changes since the last call."""
        self.publish_events()
        recorder = run.recorder
        while recorder.blocks:
            angles = recorder.blocks.popleft().angles[-1]
            if np.isfinite(angles).all():
                self._angles = angles
        self._publish_samples(recorder.assembly.take_received())
        live, start = recorder.live_estimator, recorder.assembly.recording_start
        if live is not None and live.has_estimate and start is not None:
            self._record_innovations(live)
            is_due = monotonic() - self._estimates_published_at >= _ESTIMATE_INTERVAL
            if is_due or run.sequencer.is_over:
                self._publish_estimates(live, start)
        self._publisher.publish(
            "state", **page_messages.state_message(run, self._plan, self._angles)
        )

    def _record_innovations(self, live: LiveEstimator) -> None:
        """Record the innovations for the evaluation in a window."""
        kept = self._innovations
        if kept and kept[-1][0] > live.time:  # the recording has started again
            kept.clear()
        if not kept or live.time - kept[-1][0] >= _INNOVATION_WINDOW / 60:
            kept.append((live.time, live.innovations))
        while len(kept) > 1 and kept[1][0] <= live.time - _INNOVATION_WINDOW:
            kept.popleft()

    def _nis(self, live: LiveEstimator) -> dict[str, dict[str, Any]]:
        """Return the NIS per component in the window."""
        before = self._innovations[0][1] if len(self._innovations) > 1 else {}
        result: dict[str, dict[str, Any]] = {}
        for kind, (squares, count) in live.innovations.items():
            s, n = before.get(kind, (0.0, 0))
            if count > n:
                result[kind] = page_messages.nis_fields((squares - s) / (count - n), count - n)
        return result

    def _publish_estimates(self, live: LiveEstimator, start: float) -> None:
        if live.time == self._estimates_time:
            return
        self._estimates_published_at, self._estimates_time = monotonic(), live.time
        self._publisher.publish(
            "estimates",
            time=page_messages.rounded_number(start + live.time),
            values=page_messages.rounded_numbers(live.values / self._unit_sizes),
            u2=page_messages.rounded_numbers(2 * live.std / self._unit_sizes),
            nis=self._nis(live),
        )


class MeanStream:
    """Reduces samples to means if a page could not draw all samples.

    Parameters
    ----------
    rate : float
        Largest number of samples per second of wall time.
    """

    def __init__(self, rate: float):
        self._rate, self._taken_at = rate, monotonic()
        self._remainder: tuple[Array, Array] | None = None  # samples of an incomplete mean

    def take(self, time: Array, output: Array) -> tuple[Array, Array, int] | None:
        """Return times, outputs and number of samples per mean; None if no mean is complete."""
        now = monotonic()
        a_second = time.size / max(now - self._taken_at, UPDATE_INTERVAL)
        self._taken_at = now
        k = 1 if a_second <= _RATE_TOLERANCE * self._rate else ceil(a_second / self._rate)
        if self._remainder is not None:
            time = np.concatenate([self._remainder[0], time])
            output = np.concatenate([self._remainder[1], output])
        n = time.size // k
        self._remainder = time[n * k :], output[n * k :]
        if not n:
            return None
        whole = output[: n * k].reshape(n, k, -1).mean(axis=1)
        return time[: n * k].reshape(n, k).mean(axis=1), whole, k


# Distance from a soft limit at which the lamp is on, rad. A jog toward the limit ends at this
# distance.
_LAMP_MARGIN = LIMIT_MARGIN + radians(0.02)


class ManualTelemetry(Telemetry):
    """Publishes the state of a manual session at each call.

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
        """Publish all changes since the last call."""
        self.publish_events()
        if session.imu is not None:
            self._publish_samples(session.imu.assembly.take_received())
        self._publisher.publish("state", **_state_message(session))

    def publish_plan(self, session: ManualSession) -> None:
        """Publish the table and its limits."""
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
        "trouble": (session.imu.receiver.trouble or "") if session.imu is not None else "",
        "done": 0,
        "remaining": None,
        "speed": 1.0,
        "table": None if state is None else {"axes": [axis_fields(axis) for axis in axes]},
        # These counts are omitted, because no sample is stored and angles are unknown before
        # homing.
        "imu": None if session.imu is None else imu_fields(session.imu.assembly.imu.counts),
        "live": "none",
        "attitude": None,
        "manual": [
            _manual_fields(axis, limits, task)
            for axis, limits, task in zip(axes, session.limits, session.tasks, strict=False)
        ],
    }


def _limit_fields(limits: AxisLimits) -> dict[str, float | None]:
    shown = {"rate": limits.rate, "low": limits.low, "high": limits.high}
    return {name: rounded_number(degrees(value)) for name, value in shown.items()}


def _manual_fields(axis: AxisState, limits: AxisLimits, task: AxisTask) -> dict[str, Any]:
    """Return the set values and the lamps of an axis.

    The set angle is the angle of the last move. Without a move, it is the position that the servo
    holds. This is the sum of readback and following error, if the controller reports both.
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

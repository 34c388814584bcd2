"""What a run needs is compiled before anything moves, and not while a table waits.

Cold, that is most of a minute on one core: both filters are compiled at once, in two processes.
Once that is done, on each machine, they are loaded. What is compiled is what is called, with the
arrays that a run hands it: a rest of the table is polled, sent, assembled and followed here.
"""

import json
import sys
from pathlib import Path
from subprocess import DEVNULL, Popen

import numpy as np

from inercal.benches import Turntable
from inercal.benches.turntable_attitude import motion
from inercal.host.assembly import Assembly
from inercal.host.drivers.table import AxisLimits, AxisState, TableState
from inercal.host.interlocks import Interlocks
from inercal.host.log import EVENT, IMU, TABLE, Frame
from inercal.host.navigation import Navigator
from inercal.host.packets import Layout, encode
from inercal.host.packets.picture import AXES
from inercal.host.states import pack
from inercal.methods.turntable.model import COARSE
from inercal.methods.turntable_kalman import METHOD
from inercal.methods.turntable_kalman._accelerometers import accelerometers as kernel
from inercal.methods.turntable_kalman.follow import WAYS, accelerometers, gyros
from inercal.pipeline.turntable.run import settling
from inercal.recording import Track
from inercal.runfile import Run, read
from inercal.sensors import G0

_RATE = 10.0  # Hz
_POLL = 0.02  # s
_TIED = 7.0  # s, after which the clocks are tied to one another
_AFTER = 2.0  # s that follow in a piece of their own
_TRIAD = 3
_ROOM = 298.15  # K


def compiled(run: Run, layout: Layout | None = None) -> None:
    """Have all compiled, for this process too, that a run works with while it goes on.

    Parameters
    ----------
    run : Run
        On a turntable.
    layout : Layout, optional
        Of the IMU's packets; without it nothing of packets and polls is compiled.

    Raises
    ------
    InputError
        Packets that do not go with the run file.
    """
    # Packets hold no temperature of each sample: coefficients of it are found afterwards.
    followed = run.method.name == METHOD.name and not run.sensor.uses("dT")
    if followed and run.estimator in WAYS:
        _filters(run)
    tracks = [_rest(run)] if layout is None else _assembled(run, layout)
    table = _table(run)
    checks = Interlocks((AxisLimits(),) * len(table.names), table, run.sensor)
    for track in tracks:
        checks.against_gyros(track)
    if all(len(run.sensor.only(kind).axes) == _TRIAD for kind in ("f", "w")):
        navigator = Navigator(run.sensor, table)
        for track in tracks:
            navigator.feed(track, np.zeros(len(run.sensor.coefficients)))


def _filters(run: Run) -> None:
    """Have both filters follow a rest, each compiled in a process of its own."""
    kinds = {axis.measures for axis in run.sensor.axes}
    command = [sys.executable, "-P", "-m", "inercal.host.compile", str(run.path)]
    both = len(kinds) > 1 and not _kept()
    other = Popen(command, stdin=DEVNULL, stdout=DEVNULL, stderr=DEVNULL) if both else None
    if "w" in kinds:
        _follow(run, "w")
    if other is not None:
        other.wait()
    if "f" in kinds:
        _follow(run, "f")


def _kept() -> bool:
    """Tell whether a filter was compiled before on this machine, so that it is but loaded."""
    folder = kernel.stats.cache_path
    return folder is not None and any(Path(folder).glob(f"*.{kernel.__name__}-*.nbi"))


def _follow(run: Run, kind: str) -> None:
    """Have a filter follow a table that rests."""
    filtered = gyros if kind == "w" else accelerometers
    way = WAYS[run.estimator]
    filtered(run.sensor, _table(run), _rest(run), way, run.priors, smooth=True)


def _assembled(run: Run, layout: Layout) -> list[Track]:
    """Return what is assembled of a rest, in two pieces."""
    lasting = _TIED + COARSE + 3 * settling(_table(run)) + 2 * _AFTER
    made, frames = Assembly.of(run, layout, _POLL), _frames(run, layout, lasting)
    tracks: list[Track] = []
    for early in (True, False):
        for frame in frames:
            if (frame.time < lasting - _AFTER) == early:
                made.feed(frame)
        if (block := made.take()) is not None:
            tracks.append(block.track)
    return tracks


def _frames(run: Run, layout: Layout, lasting: float) -> list[Frame]:
    """Return what the log has of a rest: polls and packets, and in between the first section."""
    assert run.rate_hz is not None
    k = len(_table(run).names)
    rests = AxisState(0.0, 0.0, 0.0, in_position=True, moving=False, enabled=True, homed=True)
    section = {"what": "section", "number": 0, "label": "", "state": "begun", "time": _TIED}
    frames = [
        _event(0.0, {"what": "session", "next": 0}),
        _event(_TIED, {**section, "hold": True}),
    ]
    for time in np.arange(0.0, lasting, _POLL).tolist():
        frames.append(Frame(TABLE, time, pack(TableState(time, (rests,) * k))))
    taken = np.arange(0.0, lasting, 1 / run.rate_hz)
    n = max(round(run.rate_hz * _POLL), 1)
    readings = _readings(run)
    step = int(layout.step or 1)
    for first in range(0, taken.size, n):
        part = taken[first : first + n]
        counter = (first + np.arange(part.size)) * step
        data = encode(layout, np.tile(readings, (part.size, 1)), counter, part, _ROOM)
        frames.append(Frame(IMU, float(part[-1]), data))
    return sorted(frames, key=lambda one: one.time)


def _event(time: float, told: dict[str, object]) -> Frame:
    return Frame(EVENT, time, json.dumps(told).encode())


def _readings(run: Run) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
    """Return what packets hold of a rest, (6,), in the order of `AXES`."""
    sensor, zero = run.sensor, np.zeros((1, len(_table(run).names)))
    felt = motion(_table(run), zero, zero, zero, {})
    found = sensor.forward(felt, np.zeros(len(sensor.coefficients)))[0]
    readings = np.zeros(len(AXES))
    places = {"f": iter(range(3)), "w": iter(range(3, 6))}
    for axis, value in zip(sensor.axes, found, strict=True):
        readings[next(places[axis.measures])] = value
    return readings


def _table(run: Run) -> Turntable:
    assert isinstance(run.bench, Turntable)
    return run.bench


def _rest(run: Run) -> Track:
    time = np.arange(0.0, COARSE + 2.0, 1 / _RATE)
    n, felt = time.size, {"f": (0.0, 0.0, G0), "w": (0.0, 0.0, 0.0)}
    reading = [felt[axis.measures][k % 3] for k, axis in enumerate(run.sensor.axes)]
    angles = np.zeros((n, len(_table(run).names)))
    return Track(time, np.tile(reading, (n, 1)), angles, np.zeros(n, dtype=np.int64))


if __name__ == "__main__":
    _follow(read(Path(sys.argv[1])), "f")

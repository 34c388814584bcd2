"""What a run needs is compiled before anything moves, and not while a table waits.

Cold, that is most of a minute on one core: both filters are compiled at once, in two processes.
Once that is done, on each machine, they are loaded.
"""

import sys
from pathlib import Path
from subprocess import DEVNULL, Popen

import numpy as np

from inercal.benches import Turntable
from inercal.host.navigation import Navigator
from inercal.methods.turntable.model import COARSE
from inercal.methods.turntable_kalman import METHOD
from inercal.methods.turntable_kalman.follow import WAYS, accelerometers, gyros
from inercal.recording import Track
from inercal.runfile import Run, read
from inercal.sensors import G0

_RATE = 10.0  # Hz


def compiled(run: Run) -> None:
    """Have both filters of a run compiled, for this process too; of other methods nothing is."""
    if run.method.name != METHOD.name or run.estimator not in WAYS:
        return
    kinds = {axis.measures for axis in run.sensor.axes}
    command = [sys.executable, "-P", "-m", "inercal.host.compile", str(run.path)]
    other = Popen(command, stdin=DEVNULL, stdout=DEVNULL, stderr=DEVNULL) if "f" in kinds else None
    if "w" in kinds:
        _follow(run, "w")
    if other is not None:
        other.wait()
        _follow(run, "f")
    if kinds == {"f", "w"}:
        Navigator(run.sensor, _table(run)).feed(_rest(run), np.zeros(len(run.sensor.coefficients)))


def _follow(run: Run, kind: str) -> None:
    """Have a filter follow a table that rests."""
    filtered = gyros if kind == "w" else accelerometers
    way = WAYS[run.estimator]
    filtered(run.sensor, _table(run), _rest(run), way, run.priors, smooth=True)


def _table(run: Run) -> Turntable:
    assert isinstance(run.bench, Turntable)
    return run.bench


def _rest(run: Run) -> Track:
    time = np.arange(0.0, COARSE + 2.0, 1 / _RATE)
    n, felt = time.size, {"f": (0.0, 0.0, G0), "w": (0.0, 0.0, 0.0)}
    reading = [felt[axis.measures][k % 3] for k, axis in enumerate(run.sensor.axes)]
    angles = np.zeros((n, len(_table(run).axes)))
    return Track(time, np.tile(reading, (n, 1)), angles, np.zeros(n, dtype=np.int64))


if __name__ == "__main__":
    _follow(read(Path(sys.argv[1])), "f")

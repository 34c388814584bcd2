"""What an operator is told during a run of a readback that the gyros contradict.

The comparison is that of the recording (`gyro_comparison`). It says what the readback does, not
why, and stops nothing: what is dangerous, the interlocks stop.
"""

from math import inf

from inercal.benches.motion_control import ControlledBench
from inercal.benches.turntable import is_turntable
from inercal.benches.turntable.reading.gyro_comparison import GyroComparison
from inercal.physics.sensors import Sensor
from inercal.recordings import Track

_INTERVAL = 60.0  # s between warnings of one kind


class ReadbackWarnings:
    """The comparison of one run.

    Parameters
    ----------
    bench : ControlledBench
        Only of a turntable there are angles to compare.
    sensor : Sensor
    """

    def __init__(self, bench: ControlledBench, sensor: Sensor):
        self._bench, self._sensor = bench, sensor
        self._said: dict[str, float] = {}  # s of the run, of the last warning of a kind
        self.restart()

    def restart(self) -> None:
        """Begin anew, as the recording does."""
        bench = self._bench
        self._comparison = (
            GyroComparison(bench, self._sensor, bench.latency.value)
            if is_turntable(bench)
            else None
        )

    def feed(self, track: Track, begin: float) -> list[str]:
        """Return warnings of the windows that these samples complete.

        Parameters
        ----------
        track : Track
            Of one trial, with known angles; it follows the one before.
        begin : float
            s of the run when the track's time is 0.
        """
        return [] if self._comparison is None else self._warnings(begin, track)

    def finish(self, begin: float) -> list[str]:
        """Return warnings of the last samples."""
        return [] if self._comparison is None else self._warnings(begin)

    def _warnings(self, begin: float, track: Track | None = None) -> list[str]:
        assert self._comparison is not None
        found = self._comparison.finish() if track is None else self._comparison.feed(track)
        result: list[str] = []
        for one in found:
            if one.stop - self._said.get(one.kind, -inf) >= _INTERVAL:
                self._said[one.kind] = one.stop
                shown = one._replace(start=one.start + begin, stop=one.stop + begin)
                result.append(shown.describe(self._bench.names))
        return result

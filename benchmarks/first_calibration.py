"""From a log to its first calibration: `inercal init` and `inercal calibrate`, kernels compiled.

The log is a CSV file of a hand-held IMU: 10⁵ rows of six channels at 100 Hz, with 28 rests.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

from tests import generated_logs as logs

from benchmarks import Duration, Row
from benchmarks.start_up import REPEAT, processor_time

ROWS, RESTS = 100_000, 28
LIMIT = 3.0  # s, of all processes
HEAD = ("t", "ax", "ay", "az", "gx", "gy", "gz")


def rows() -> list[Row]:
    """Time both verbs after a first turn, which compiles."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        log, run_file = folder / "log.csv", folder / "log.toml"
        device = logs.by_hand(1, RESTS, still=34.72)
        columns = [column[:ROWS] for column in (device["t"], *device["f"].T, *device["w"].T)]
        logs.write(log, HEAD, columns)

        def both() -> Duration:
            parts = [
                processor_time("init", log, "--yes", "--force", "--out", run_file),
                processor_time("calibrate", run_file, "--force", "--out", folder),
            ]
            wall, processor = (
                sum(getattr(part, what) for part in parts) for what in ("wall", "processor")
            )
            return Duration(processor, wall, processor)

        both()
        taken = min(both() for _ in range(REPEAT))
    return [Row("init and calibrate a log of 10⁵ rows by hand", taken, LIMIT, "limit")]

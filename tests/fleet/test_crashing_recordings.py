"""A line of few sensors, which is calibrated in one process, survives what crashes a library."""

from pathlib import Path

import pytest
from tests.fleet.lines import make_line, rows_of, write_table
from tests.io.isolated_functions import crash

from inercal.basics.parallel import SerialExecutor
from inercal.fleet.calibration import calibrate_line
from inercal.fleet.line import read_line
from inercal.recordings.io.isolation import Isolation
from inercal.recordings.io.readers import READERS, Reader

CRASHING = Reader("crashing", crash, suffixes=(".crash",), isolation=Isolation("a recording"))


@pytest.mark.slow
def test_a_recording_that_crashes_its_library_fails_alone(tmp_path: Path):
    folder = make_line(tmp_path, 3)
    (folder / "recordings/S001.crash").write_bytes(b"damaged")
    write_table(
        folder,
        [(f"S00{k}", f"recordings/S00{k}.{s}") for k, s in enumerate(("npz", "crash", "npz"))],
    )
    with READERS.with_("crashing", CRASHING):
        counts = calibrate_line(read_line(folder), SerialExecutor())
    assert (counts.done, counts.failed) == (2, 1)
    (failed,) = (row for row in rows_of(folder) if row["status"] == "failed")
    assert (failed["id"], failed["error_type"], failed["traceback"]) == ("S001", "InputError", "")
    assert "SIGSEGV" in failed["error"]

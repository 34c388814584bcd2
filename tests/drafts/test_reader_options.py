"""What is stated for a reader of files holds while a run file is drafted, too."""

from pathlib import Path

import numpy as np
import pytest
from tests.io.log_files import (
    SAMPLES,
    ardupilot_corrected,
    dataflash_bytes,
    px4_corrected,
    ulog_bytes,
    write_marks,
)
from tests.io.test_io_xlsx import workbook
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.pipeline.drafts import draft_run_file
from inercal.pipeline.drafts.rest_recording import read_rest_recording

NOTES = [["note", "number"], ["begin", 1.0]]
DATA = [["time", "ax", "ay", "az"], *([k / 10, 0.0, 0.0, 9.81] for k in range(40))]
COMBINED = ("sensor_combined", "sensor_selection")
SECOND = {"data.sheet": "run 2"}


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({}, "the columns note, number"),
        (SECOND | {"data.most_values": "159"}, "more than [data] most_values = 159"),
        (SECOND | {"data.most_values": "160"}, "no method fits these data"),
    ],
)
def test_a_sheet_and_a_limit_are_those_stated(stated: dict[str, str], said: str, tmp_path: Path):
    path = workbook(tmp_path / "log.xlsx", NOTES, DATA)
    with pytest.raises(InputError) as refusal:
        draft_run_file([path], tmp_path / "run.toml", stated)
    assert said in str(refusal.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "content", "corrected"),
    [
        ("log.ulg", ulog_bytes(SAMPLES, topics=COMBINED), px4_corrected(SAMPLES)),
        ("log.bin", dataflash_bytes(SAMPLES), ardupilot_corrected(SAMPLES)),
    ],
)
def test_corrections_of_a_controller_are_kept_on_wish(
    name: str, content: bytes, corrected: tuple[np.ndarray, np.ndarray], tmp_path: Path
):
    if name == "log.ulg":
        pytest.importorskip("pyulog")
    path = tmp_path / name
    path.write_bytes(content)
    keep = {"data.corrections": "keep"}
    found = read_rest_recording(path, keep)
    assert found.kept_corrections
    np.testing.assert_allclose(found.data, np.hstack(corrected), rtol=0, atol=1e-5)
    assert not read_rest_recording(path, {}).kept_corrections
    write_marks(tmp_path / "marks.json")
    marks = {"data.marks": "marks.json"}
    undone = draft_run_file([path], tmp_path / "run.toml", marks).readings["accelerometer"]
    assert np.abs(undone - corrected[0]).max() > 1
    # The corrected axes are those of the vehicle, so the marks name other positions.
    with refused():
        draft_run_file([path], tmp_path / "run.toml", marks | keep)

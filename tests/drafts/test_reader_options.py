"""What is stated for a reader of files holds while a run file is drafted, too."""

from pathlib import Path

import pytest
from tests.io.test_io_xlsx import workbook

from inercal.basics.errors import InputError
from inercal.pipeline.drafts import draft_run_file

NOTES = [["note", "number"], ["begin", 1.0]]
DATA = [["time", "ax", "ay", "az"], *([k / 10, 0.0, 0.0, 9.81] for k in range(40))]
SECOND = {"data.sheet": "run 2"}


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({}, "the columns are note, number"),
        (SECOND | {"data.most_values": "159"}, "more than [data] most_values = 159"),
        (SECOND | {"data.most_values": "160"}, "no method fits these data"),
    ],
)
def test_a_sheet_and_a_limit_are_those_stated(stated: dict[str, str], said: str, tmp_path: Path):
    path = workbook(tmp_path / "log.xlsx", NOTES, DATA)
    with pytest.raises(InputError) as refusal:
        draft_run_file([path], tmp_path / "run.toml", stated)
    assert said in str(refusal.value)

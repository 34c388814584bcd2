"""Readings beside the head's angle, and the keys by which a run file or a draft uses them."""

import shutil
from pathlib import Path

import pytest
from tests.refusals import refused

from inercal import runfile
from inercal.benches.dividing_head.reading import observe
from inercal.pipeline.drafts import draft_run_file

EXAMPLES = Path(__file__).parents[2] / "examples" / "dividing_head"


def changed_lab(folder: Path, *changes: tuple[str, str]) -> Path:
    """Write the example with the worksheet, with changes of its run file; return the path."""
    shutil.copytree(EXAMPLES, folder, dirs_exist_ok=True)
    text = (EXAMPLES / "lab.toml").read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "lab.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_readings_that_the_bench_would_ignore_are_refused(tmp_path: Path):
    keys = ('autocollimation = "pairs"', 'polygon = "polygon.csv"')
    gone = [(f"{key}\n", "") for key in (*keys, 'autocollimator = "0.1 ″"')]
    gone.append(('certificate = "0.05 ″"\n', ""))
    with refused(key="[bench] autocollimation"):
        observe(runfile.read(changed_lab(tmp_path, *gone)))
    unread = changed_lab(tmp_path, *gone, ('autocollimator = "autocollimator"\n', ""))
    assert len(observe(runfile.read(unread)).steps) == 24


@pytest.mark.parametrize(("filled", "mode"), [("", "pairs"), ("0.5", "every")])
def test_a_draft_uses_a_filled_autocollimator_column(filled: str, mode: str, tmp_path: Path):
    lines = (EXAMPLES / "lab.csv").read_text(encoding="utf-8").replace(",,", f",{filled},")
    head, _, rows = lines.partition("\n")
    names = "position,angle [deg],a [mV],b [mV],autocollimator [µrad],level"
    assert head == "position,angle,a,b,autocollimator,level"
    (tmp_path / "lab.csv").write_text(f"{names}\n{rows}", encoding="utf-8")
    stated = {"method.name": "dual_orthogonal"}
    draft = draft_run_file([tmp_path / "lab.csv"], tmp_path / "run.toml", stated)
    found = {one.dotted: one.value for one in draft.entries}
    assert found["bench.autocollimation"] == mode
    assert found["data.autocollimator_unit"] == "µrad"
    assert found["data.angle_unit"] == "deg"
    assert found["sensor.accelerometer.unit"] == "mV"
    assert found["sensor.accelerometer.scale"] == "2.999 mV/g"

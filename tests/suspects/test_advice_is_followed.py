"""Every piece of advice that changes keys is followed: the run is accepted, and χ² falls as said.

Of examples, of devices with each violation, and of the failing inputs of public reports.
"""

import re
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest
from tests.advice_followed import follow_all
from tests.base_seeds import chosen
from tests.evidence.violation_cells import CASES, base_cells, case_cells, device_files, find_case

import inercal
from inercal.basics.errors import InercalError
from inercal.basics.units import parse_quantity
from inercal.pipeline.drafts import draft_run_file

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
QUICK = ("tumble", "dual_orthogonal", "ship_planar")
# Examples whose data are in the repository and that take no longer than a second.
RUN_FILES = (
    "verdict/left_out.toml",
    "dividing_head/tumble.toml",
    "dividing_head/lab.toml",
    "rate_platform/gyros.toml",
    "rate_platform/imu.toml",
    "six_position/run.toml",
    "centrifuge/lab.toml",
    "centrifuge/corrected.toml",
    "rate_table/ship.toml",
)
ONE_OF_EACH = (
    "verdict/left_out.toml",
    "dividing_head/lab.toml",
    "rate_platform/gyros.toml",
    "centrifuge/lab.toml",
    "rate_table/ship.toml",
)
REPORTS = (
    "01_same_from_zero.csv",
    "02_gyro_two_decimals.csv",
    "05_freezer_whole_degrees.toml",
    "08_record_player.toml",
    "12_z_offset_1g.csv",
    "17_coarse_gyro_one_sense.csv",
)


def kept_advice(run_file: Path) -> int:
    """Calibrate, follow all advice, and return how many pieces changed keys.

    A run that is refused gives no advice.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            outcome = inercal.calibrate(run_file)
        except InercalError:
            return 0
        followed = follow_all(run_file, outcome)
    assert [one for one in followed if not one.kept] == []
    return len(followed)


def follow_cells(name: str, folder: Path, every: int = 1) -> int:
    """Follow the advice on one device of each cell of a case, or of every n-th."""
    count, cells = 0, (next(base_cells(name)), *case_cells(name))
    for k, cell in enumerate(cells[::every]):
        own = folder / str(k)
        own.mkdir()
        for file, content in device_files(cell, 0)[0].items():
            raw = content.encode() if isinstance(content, str) else content
            (own / file).write_bytes(raw)
        count += kept_advice(own / "run.toml")
    return count


@pytest.mark.slow
@pytest.mark.parametrize("name", chosen(RUN_FILES, ONE_OF_EACH))
def test_advice_on_an_example_is_kept(name: str, tmp_path: Path):
    folder = tmp_path / "example"
    shutil.copytree(EXAMPLES / Path(name).parent, folder)
    kept_advice(folder / Path(name).name)


@pytest.mark.slow
@pytest.mark.parametrize("name", QUICK)
def test_advice_on_some_violations_is_kept(name: str, tmp_path: Path):
    assert follow_cells(name, tmp_path, every=4) > 0


@pytest.mark.evidence
@pytest.mark.parametrize("name", CASES)
def test_advice_on_violations_is_kept(name: str, tmp_path: Path):
    count = follow_cells(name, tmp_path)
    # Neither six positions nor Ferraris' sections leave anything to estimate.
    assert count > 0 or name.startswith(("six_position", "ferraris"))


@pytest.mark.evidence
@pytest.mark.parametrize("name", REPORTS)
def test_advice_on_a_reported_input_is_kept(name: str, tmp_path: Path):
    folder = ROOT.parent / "shared" / "reports"
    if not folder.is_dir():
        pytest.skip(f"no reported inputs at {folder}")
    for one in folder.glob(f"{Path(name).stem}.*"):
        shutil.copy(one, tmp_path)
    run_file = tmp_path / name
    if run_file.suffix != ".toml":
        stated = {"sensor.gyro.unit": "°/s"}
        try:
            draft = draft_run_file([run_file], tmp_path / "run.toml", stated)
        except InercalError as error:
            pytest.skip(f"refused: {error}")
        run_file = draft.path
        run_file.write_text(draft.text, encoding="utf-8")
    kept_advice(run_file)


STATED, COMPUTED = 'gravity = "9.80123 m/s² ± 0.1 mm/s²"', 'height = "500 m"'


@pytest.mark.slow
@pytest.mark.parametrize(
    ("error", "size", "gravity", "value"),
    [
        ("g", 4e-3, STATED, r"9\.80123 m/s² ± (\d\.?\d mm/s²)"),
        ("g", 4e-3, COMPUTED, r"9\.799\d{1,3} m/s² ± (\d\.?\d mm/s²)"),
        ("tilt", 1e-3, STATED, r"(\d\d0 ″)"),
    ],
)
def test_advice_on_the_bench_is_stated_in_the_unit_of_its_key(
    error: str, size: float, gravity: str, value: str, tmp_path: Path
):
    rng = np.random.default_rng(8)
    case = find_case("centrifuge_norm")
    drawn = case.draw(rng)
    drawn = {**drawn, error: drawn.get(error, 0.0) + size}
    for name, content in case.files(drawn, rng, None).items():
        (tmp_path / name).write_text(str(content).replace(STATED, gravity), encoding="utf-8")
    outcome = inercal.calibrate(tmp_path / "run.toml")
    (change,) = next(one for one in outcome.verdict.advice if one.changes).changes
    found = re.fullmatch(value, change.value)
    assert found, change.value
    deviation = parse_quantity(found[1], "m/s²" if error == "g" else "rad").value
    assert deviation == pytest.approx(size, rel=0.7)

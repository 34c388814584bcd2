"""Every piece of advice that changes keys is followed: the run is accepted, and χ² falls as said.

Of examples, of devices with each violation, and of the failing inputs of public reports.
"""

import re
import shutil
import tomllib
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.advice_followed import follow_all
from tests.base_seeds import chosen
from tests.evidence.violation_cells import CASES, base_cells, case_cells, device_files, find_case
from tests.runfile.key_sweep import example, toml

import inercal
from inercal.basics.errors import InercalError
from inercal.basics.run_file_advice import Change, with_changes
from inercal.basics.units import parse_quantity
from inercal.benches.kind_definition import KINDS
from inercal.pipeline import apply_data_columns, simulate
from inercal.pipeline.drafts import draft_run_file
from inercal.recordings.io.write import write_recording
from inercal.runfile import from_sections, read

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


RECORDED: dict[str, tuple[str, tuple[tuple[str, str, object], ...]]] = {
    "rates_and_poses": (
        "rate_platform/imu.toml",
        (
            ("sensor.accelerometer", "white", "40 µg/√Hz"),
            ("sensor.gyro", "white", "0.1 °/√h"),
            ("bench", "arm", "5 mm"),
            *(("data", key, None) for key in ("kind", "axis", "table_rate", "roll", "pitch", "sd")),
            ("data", "marks", "labels"),
            ("data", "label", "label"),
            ("method", "also", ["g"]),
            ("method", "rates", ["50 °/s"]),
            ("method", "attitudes", "faces"),
        ),
    ),
    "systematic": (
        "systematic/imu.toml",
        (("method", "seconds", "12 s"), ("method", "also", ["g"])),
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", RECORDED)
def test_coefficients_that_are_advised_for_a_recording_are_determined_together(
    name: str, tmp_path: Path
):
    example_file, changes = RECORDED[name]
    stored = (("data", "file", "log.npz"), ("data", "rate", "20 Hz"))
    path = tmp_path / "run.toml"
    path.write_text(toml(example(example_file, *stored, *changes)), encoding="utf-8")
    run = read(path)
    write_recording(apply_data_columns(run, simulate(run, 1)), run.file(run.data.file))
    followed = follow_all(path, inercal.calibrate(path))
    assert {one.refused for one in followed} <= {""}


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


KEYS = {"g": "gravity"}  # of parameters with another name


@pytest.mark.parametrize("name", ["dividing_head/lab", "rate_platform/gyros"])
def test_every_uncertainty_that_a_verdict_asks_for_can_be_stated(name: str, tmp_path: Path):
    folder = tmp_path / "example"
    shutil.copytree((EXAMPLES / name).parent, folder)
    run_file = folder / f"{Path(name).name}.toml"
    outcome = inercal.calibrate(run_file)
    asked = [a.reason for a in outcome.verdict.advice if a.action == "state its uncertainty"]
    assert asked
    content = tomllib.loads(run_file.read_text(encoding="utf-8"))
    fields = KINDS[content["bench"]["kind"]].section.model_fields
    for key in (KEYS.get(one, one) for one in asked):
        known = content["bench"].get(key, fields[key].default)
        example = next(iter(fields[key].examples or ()), known)
        changed = Change("bench", key, example)
        sections = with_changes(content, (changed,))
        from_sections(run_file, sections, "")


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


def test_coefficients_that_the_positions_hardly_separate_are_not_advised_together():
    """At multiples of 45°, an odd quadratic and a cubic have almost the same effect."""
    rng = np.random.default_rng(4)
    around = [(roll, 0) for roll in range(0, 360, 45)]
    tilted = [(roll, pitch) for roll in (0, 90, 180, 270) for pitch in (45, -45)]
    few = [(0, 90), (0, -90), (45, 30), (135, -30), (225, 30), (45, -60), (225, 60)]
    roll, pitch = np.radians(np.array([*around, *tilted, *few])).T
    up = [-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)]
    f = np.array(up).T + 20e-6 * rng.standard_normal((len(roll), 3))
    table = {"roll": np.degrees(roll), "pitch": np.degrees(pitch)}
    table |= dict(zip(("ax", "ay", "az"), f.T, strict=True))
    keys: dict[str, Any] = {
        "sensor": {"accelerometer": {"unit": "g"}},
        "bench": {"kind": "rate_platform", "gravity": "9.80665 m/s² ± 0.05 mm/s²",
                  "attitude": "0.01 °", "mounting": "0.05 °"},
        "kind": "means", "roll": "roll", "pitch": "pitch",
        "accelerometer": ["ax", "ay", "az"], "sd": {"accelerometer": "20 µg"},
    }  # fmt: skip
    method = {"name": "rates_and_poses", "also": ["k2"]}
    verdict = inercal.calibrate(table, method=method, **keys).verdict
    (advised,) = [words for one in verdict.advice if (words := one.coefficients)]
    assert "k3" in advised
    assert not {"k3", "koq"} <= set(advised)
    both = inercal.calibrate(table, method={**method, "also": ["k2", "k3", "koq"]}, **keys)
    alone = inercal.calibrate(table, method={**method, "also": ["k2", "k3"]}, **keys)
    u = [dict(zip(one.estimate.names, one.estimate.std, strict=True)) for one in (both, alone)]
    assert u[0]["ay.k3"] > 5 * u[1]["ay.k3"]

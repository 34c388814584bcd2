"""The worksheet of a rate table: what it says, and what comes of filling it."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.accuracy import rate_table as made
from tests.refusals import refused

from inercal.basics.errors import InputError, NotObserved
from inercal.pipeline import calibrate
from inercal.pipeline.design.worksheet import Worksheet, build_worksheet, worksheet_csv
from inercal.runfile import read

EXAMPLE = Path(__file__).parents[2] / "examples" / "rate_table" / "ship.toml"
BENCH = made.Bench(lean=0.05 * made.DEGREE)


def planned(folder: Path, *changes: tuple[str, str]) -> Worksheet:
    text = EXAMPLE.read_text(encoding="utf-8")
    for old, new in (('"ship.csv"', '"sheet.csv"'), *changes):
        assert old in text
        text = text.replace(old, new)
    (folder / "run.toml").write_text(text, encoding="utf-8")
    return build_worksheet(read(folder / "run.toml"))


def fill(sheet: Worksheet, path: Path, seed: int) -> made.Draw:
    """Write the sheet filled with the readings of a device that the generator draws."""
    header, *lines = csv.reader(worksheet_csv(sheet).splitlines())
    states: list[made.State] = []
    for line in lines:
        tilts = [float(tilt) for tilt in line[0][2:].split("+") if tilt]
        second = tilts[1] if len(tilts) > 1 else None
        states.append((line[0][:2], tilts[0] if tilts else 0.0, second, float(line[1])))
    drawn = made.draw(seed, 1, BENCH, tuple(states))
    codes = 16384 * drawn.readings[0]
    filled = [[*line[:2], *map(str, row)] for line, row in zip(lines, codes.tolist(), strict=True)]
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([header, *filled])
    return drawn


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_who_fills_the_sheet_finds_the_device(tmp_path: Path, seed: int):
    # Gravity and radius are those of the generator.
    sheet = planned(tmp_path, ('"9.7936 m/s² ± 0.5 mm/s²"', f'"{made.G} m/s²"'),
                    ('"250 mm ± 0.3 mm"', '"250 mm"'))  # fmt: skip
    drawn = fill(sheet, tmp_path / "sheet.csv", seed)
    found = calibrate(sheet.run)
    calibration = found.calibration
    for k, axis in enumerate("xyz"):
        for name, true in (
            (f"a{axis}.k0", drawn.bias[0, k] * made.G),
            (f"a{axis}.k1", drawn.matrix[0, k, k] - 1),
        ):
            assert abs(calibration.value(name) - true) < 4 * calibration.uncertainty(name)
    assert found.estimate.consistent
    expected = [one.std for one in sheet.expected]
    stated = np.sqrt(np.diagonal(found.estimate.covariance)[: len(expected)])
    assert stated == pytest.approx(expected, rel=0.15)  # of another device than an ideal one


def test_what_is_felt_is_what_the_generator_says(tmp_path: Path):
    sheet = planned(tmp_path).sheet
    facts = [row.facts for row in sheet.rows]
    by_name = {(fact["mounting"], round(fact["rpm"])): fact["felt"] for fact in facts}
    assert by_name["XY30", 46] == pytest.approx(
        made.columns("XY", 30.0, None, "azimuth") @ [made.centripetal(46.0) * made.G, 0.0, 9.7936]
    )
    assert [row.cells[0] for row in sheet.rows] == [str(k) for k in range(1, 26)]
    assert sheet.seconds == 25 * 150


def test_rates_are_written_in_the_unit_of_their_column(tmp_path: Path):
    sheet = planned(tmp_path, ('arm_rate = "rpm"', 'arm_rate = "w"\narm_rate_unit = "rad/s"'))
    header, first, second, *_ = worksheet_csv(sheet).splitlines()
    assert header == "mounting,w,ax,ay,az"
    assert first == "XY,0,,,"
    assert float(second.split(",")[1]) == pytest.approx(46 * made.RPM)


def test_columns_by_number_have_no_name_to_write(tmp_path: Path):
    sheet = planned(tmp_path)
    data = sheet.run.data.model_copy(update={"arm_rate": 2})
    numbered = build_worksheet(replace(sheet.run, data=data))
    with refused(InputError, key="[data]", names=("2",)):
        worksheet_csv(numbered)


def test_noise_that_is_not_stated_is_asked_for(tmp_path: Path):
    with refused(InputError, key="[sensor.accelerometer] white"):
        planned(tmp_path, ('[data.sd]\naccelerometer = "0.3 mg"\n', ""))


def test_a_plan_that_leaves_coefficients_open_says_which(tmp_path: Path):
    sheet = planned(tmp_path)
    run = replace(sheet.run, plan=lambda: sheet.run.steps[:3])
    with refused(NotObserved, file="run.toml") as refusal:
        build_worksheet(run)
    assert "3 states" in str(refusal.value)
    assert "YX" in str(refusal.value)

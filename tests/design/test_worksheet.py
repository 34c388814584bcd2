"""The worksheet of a dividing head: what it says, and what comes of doing as it says."""

import csv
import re
from dataclasses import replace
from math import cos, pi, radians, sin
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.basics.errors import InputError, NotObserved
from inercal.benches.operator_sheet import SheetRow
from inercal.physics.motion import Motion
from inercal.physics.plan import Index
from inercal.pipeline import calibrate
from inercal.pipeline.design.worksheet import Worksheet, build_worksheet, worksheet_csv
from inercal.runfile import read

ARCSEC = pi / 648_000
UG = 9.80665e-6
G, SD, AUTOCOLLIMATOR, TRIMMED = 9.80153, 0.05 * UG, 0.03 * ARCSEC, 0.2 * ARCSEC
HEAD = (1.9 * ARCSEC, 1.6 * ARCSEC)  # harmonics
FACES = (0.4, -2.1, 3.0, 1.2, -1.7, 2.6, -3.3, 0.9, 1.1, -0.6, 2.2, -2.8)  # ″
RUN = """\
[sensor]
name = "QA pair 7"

[sensor.accelerometer]
unit = "V"
scale = "3 V/g"

[sensor.truth]
"a.k0" = "310 µg"
"a.k1" = "-180 ppm"
"a.delta_o" = "9 ″"
"a.k2" = "12 µg/g²"
"a.k3" = "4 µg/g³"
"a.kip" = "-5 µg/g²"
"b.k0" = "-240 µg"
"b.delta_o" = "-5 ″"
"b.k2" = "-8 µg/g²"

[bench]
kind = "dividing_head"
gravity = "9.80153 m/s² ± 2 µm/s²"
harmonics = ["1.9 ″", "1.6 ″"]
division = "1.6 ″"
autocollimation = "pairs"
autocollimator = "0.03 ″"
polygon = "faces.csv"
certificate = "0 ″"
base = "10 ″"
pier = "0 ″"
lean = "0 ″"
drift = "0 µg"

[data]
file = "sheet.csv"
kind = "means"
accelerometer = ["volts A", "volts B"]
label = "position"
angle = "head"
autocollimator = "mirror"

[data.sd]
accelerometer = "0.05 µg"

[method]
name = "dual_orthogonal"
seconds = "30 s"

[method.prior]
"a.kip" = "0 ± 5 µg/g²"
"b.kip" = "0 ± 5 µg/g²"
"""
ALONE = ('autocollimator = "mirror"\n', "")
EVERY = (
    'harmonics = ["1.9 ″", "1.6 ″"]\ndivision = "1.6 ″"\nautocollimation = "pairs"',
    'autocollimation = "every"',
)


def run_file(folder: Path, *changes: tuple[str, str]) -> Path:
    text = RUN
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "run.toml"
    path.write_text(text, encoding="utf-8")
    lines = [f"{k},{deviation}" for k, deviation in enumerate(FACES, start=1)]
    (folder / "faces.csv").write_text("\n".join(["face,deviation", *lines]), encoding="utf-8")
    return path


def planned(folder: Path, *changes: tuple[str, str]) -> Worksheet:
    return build_worksheet(read(run_file(folder, *changes)))


def done_with(row: SheetRow) -> str:
    """Return what is done with the autocollimator, in words."""
    return row.facts["autocollimator"]


class Operator:
    """Does what the rows say, on a head that errs, before a polygon whose faces deviate."""

    def __init__(self, seed: int):
        self.rng = np.random.default_rng(seed)
        self.waves = [sd * self.rng.standard_normal(2) for sd in HEAD]
        self.division = 1.6 * ARCSEC * self.rng.standard_normal(360)
        self.line = 0.3 * ARCSEC  # where the autocollimator looks
        self.read: dict[tuple[int, str], float] = {}

    def at(self, row: SheetRow) -> tuple[float, float | None]:
        """Return where the head truly stands beyond its angle, and what was written down, rad."""
        angle, act, in_pass = radians(row.facts["angle_deg"]), done_with(row), row.facts["pass"]
        face = FACES[round(angle * 6 / pi) % 12] * ARCSEC
        beyond = self.division[round(angle * 180 / pi)]
        for h, (a, b) in enumerate(self.waves, start=1):
            beyond += a * sin(h * angle) + b * cos(h * angle)
        if not act:
            return beyond, None
        noise = AUTOCOLLIMATOR * self.rng.standard_normal()
        if trimmed := re.search(r"trim .* as at (\S+)°(?: in pass (\d+))?", act):
            mark = self.read[int(trimmed[2] or in_pass), trimmed[1]]
            # It is written down how well it was trimmed, or else it is trimmed well.
            recorded = act.endswith("write down")
            reading = mark + recorded * TRIMMED * self.rng.standard_normal()
            beyond = reading + face - self.line - noise
        else:
            reading = beyond - face + self.line + noise
        self.read.setdefault((in_pass, row.cells[2].rstrip("°")), reading)  # as it is printed
        return beyond, reading


def fill(sheet: Worksheet, path: Path, seed: int) -> None:
    """Write the sheet with its empty cells filled."""
    run, operator = sheet.run, Operator(seed)
    header, *lines = csv.reader(worksheet_csv(sheet).splitlines())
    sensor = run.sensor.with_coefficients(*run.truth)
    c = np.array([run.truth[name] for name in sensor.coefficients])
    filled = [header]
    for row, line in zip(sheet.sheet.rows, lines, strict=True):
        cells = dict(zip(header, line, strict=True))
        assert float(cells["head"]) == pytest.approx(row.facts["angle_deg"], abs=1e-9)
        beyond, reading = operator.at(row)
        psi = radians(float(cells["head"])) + beyond + 4 * ARCSEC
        f = G * np.array([[sin(psi), cos(psi), 0.0]])
        volts = sensor.to_output(
            sensor.forward(Motion(f), c) + SD * operator.rng.standard_normal((1, 2))
        )
        cells |= {"volts A": f"{volts[0, 0]:.12g}", "volts B": f"{volts[0, 1]:.12g}"}
        if "mirror" in cells and reading is not None:
            cells["mirror"] = f"{reading / ARCSEC:.3f}"
        filled.append(list(cells.values()))
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows(filled)


@pytest.mark.parametrize(
    "changes", [(), (ALONE,), (EVERY,), (EVERY, ALONE)], ids=["pairs", "pairs+", "every", "every+"]
)
@pytest.mark.parametrize("seed", [0, 1])
def test_who_does_as_the_sheet_says_finds_the_truth(
    tmp_path: Path, changes: tuple[tuple[str, str], ...], seed: int
):
    sheet = planned(tmp_path, *changes)
    fill(sheet, tmp_path / "sheet.csv", seed)
    found = calibrate(sheet.run)
    assert [step.label for step in found.steps] == [row.label for row in sheet.sheet.rows]
    done = [step for step in found.steps if isinstance(step, Index)]
    senses = ["forward" if step.sense > 0 else "reverse" for step in done]
    assert senses == [row.facts["sense"] for row in sheet.sheet.rows]
    calibration = found.calibration
    truth = np.array([sheet.run.truth.get(n, 0.0) for n in calibration.sensor.coefficients])
    error = calibration.values - truth
    p = error.size
    nees = error @ np.linalg.solve(calibration.covariance, error) / p
    assert nees < 1 + 4 * np.sqrt(2 / p)
    assert found.estimate.consistent
    expected = np.array([one.std for one in sheet.expected])
    assert np.sqrt(np.diagonal(found.estimate.covariance)[:p]) == pytest.approx(expected, rel=0.02)


def test_a_pair_is_trimmed_to_one_mark_also_on_the_way_back(tmp_path: Path):
    sheet = planned(tmp_path, ALONE).sheet
    said = {row.label: done_with(row) for row in sheet.rows if done_with(row)}
    assert said == {
        "f01": "read and write down",
        "f04": "read and write down",
        "f07": "trim the head until it reads as at 0°",
        "f10": "trim the head until it reads as at 90°",
        "r10": "trim the head until it reads as at 90° in pass 1",
        "r07": "trim the head until it reads as at 0° in pass 1",
        "r04": "trim the head until it reads as at 90° in pass 1",
        "r01": "trim the head until it reads as at 0° in pass 1",
    }
    assert any("the polygon's certificate" in note for note in sheet.notes)


def test_where_it_is_written_down_the_head_itself_comes_back_to_0_and_90(tmp_path: Path):
    said = {row.label: done_with(row) for row in planned(tmp_path).sheet.rows}
    assert [said[label] for label in ("f01", "f04", "r04", "r01")] == ["read and write down"] * 4
    assert said["f10"] == "trim the head until it reads as at 90°, and write down"
    assert said["r07"] == "trim the head until it reads as at 0° in pass 1, and write down"


def test_readings_on_every_face_are_written_down_and_nothing_is_trimmed(tmp_path: Path):
    sheet = planned(tmp_path, EVERY).sheet
    assert {done_with(row) for row in sheet.rows} == {"read and write down"}
    assert not any("trim" in note for note in sheet.notes)


def test_without_an_autocollimator_nothing_is_done_with_it(tmp_path: Path):
    keys = 'autocollimator = "0.03 ″"\npolygon = "faces.csv"\ncertificate = "0 ″"\n'
    none = ('autocollimation = "pairs"\n' + keys, 'autocollimation = "none"\n')
    sheet = planned(tmp_path, none).sheet
    assert not any(done_with(row) for row in sheet.rows)
    assert not any("autocollimator" in note for note in sheet.notes)


def test_sums_known_far_better_than_their_terms_are_said_as_the_calibration_says_them(
    tmp_path: Path,
):
    sheet = planned(tmp_path)
    names = [one.name for one in sheet.together]
    assert names == ["a.k1 + a.k3 g²", "b.k1 + b.k3 g²", "b.delta_o − a.delta_o"]
    alone = {one.name: one.std for one in sheet.expected}
    assert sheet.together[0].std < alone["a.k1"] / 3
    fill(sheet, tmp_path / "sheet.csv", 0)
    estimate = calibrate(sheet.run).estimate
    assert f"± {2 * sheet.together[2].std / ARCSEC:.2g} ″ (k = 2)" in " ".join(estimate.notes)
    gain, weights = estimate.select(("a.k1", "a.k3")).covariance, np.array([1.0, G**2])
    assert weights @ gain @ weights == pytest.approx(sheet.together[0].std ** 2, rel=0.05)


def test_a_plan_that_leaves_coefficients_open_says_which(tmp_path: Path):
    with refused(NotObserved, file="run.toml") as refusal:
        planned(tmp_path, ("seconds =", "positions = 4\nseconds ="))
    assert "8 positions" in str(refusal.value)


def test_pairs_need_all_four_positions(tmp_path: Path):
    with refused(InputError) as refusal:
        planned(tmp_path, ("seconds =", "positions = 10\nseconds ="))
    assert "90°, 270°" in str(refusal.value)


def test_positions_on_no_face_are_refused(tmp_path: Path):
    with refused(InputError) as refusal:
        planned(tmp_path, EVERY, ("seconds =", "positions = 24\nseconds ="))
    assert "f02" in str(refusal.value)


def test_noise_that_is_not_stated_is_asked_for(tmp_path: Path):
    with refused(InputError, key="[sensor.accelerometer] white"):
        planned(tmp_path, ('[data.sd]\naccelerometer = "0.05 µg"\n', ""))


def test_columns_by_number_have_no_name_to_write(tmp_path: Path):
    sheet = planned(tmp_path)
    data = sheet.run.data.model_copy(update={"angle": 2})
    numbered = build_worksheet(replace(sheet.run, data=data))
    with refused(InputError, key="[data]", names=("2",)):
        worksheet_csv(numbered)


def test_angles_are_written_in_the_unit_of_their_column(tmp_path: Path):
    sheet = planned(tmp_path, ('angle = "head"', 'angle = "head"\nangle_unit = "′"'))
    lines = worksheet_csv(sheet).splitlines()
    assert lines[:3] == ["position,head,volts A,volts B,mirror", "f01,0,,,", "f02,1800,,,"]

"""A guided measurement of every method with a worksheet: what is asked is what calibrate reads."""

import csv
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import chdtri
from tests.base_seeds import chosen
from tests.benches.generated_runs import (
    calibrate_run,
    kind_for,
    read_off,
    simulate_run,
    state_means,
    write_run,
)
from tests.host.guided_runs import measure

from inercal.methods import METHODS
from inercal.physics.plan import Turn
from inercal.pipeline import calibrate
from inercal.pipeline.design.worksheet import run_sheet, table_rows
from inercal.runfile import Run, read

EXAMPLES = Path(__file__).parents[2] / "examples"
WITH_SHEET = [
    name for name, one in METHODS.items() if kind_for(name).sheet and not one.unknown_attitudes
]


def asked(run: Run, readings: dict[str, list[float]]) -> list[str]:
    """Return the lines that an operator types, in the order of the worksheet."""
    sheet, durations = run_sheet(run), {step.label: step.seconds for step in run.steps}
    turns = {step.label for step in run.steps if isinstance(step, Turn)}
    found: list[str] = []
    for row in sheet.rows:
        duration = [durations[row.label]] if row.label in turns else []
        assert len(sheet.entry_columns(row)) == len(duration) + len(run.sensor.axes)
        found.append(" ".join(map(repr, [*duration, *readings[row.label]])) + "\n")
    return found


@pytest.mark.slow
@pytest.mark.parametrize("method", chosen(WITH_SHEET, ("ferraris", "rates_and_poses")))
def test_errors_of_what_was_measured_are_as_stated(method: str, tmp_path: Path):
    more = "turns = 10" if kind_for(method).rows_of_table else ""
    run = simulate_run(write_run(method, tmp_path, more), 1)
    header = table_rows(run, run_sheet(run))[0]
    state_means(run, "sheet.csv", labelled="label" in header)
    stated = replace(read(run.path), truth=run.truth)
    given = asked(stated, read_off(stated, np.random.default_rng(2)))
    half = len(given) // 2
    assert measure(run.path, given=given[:half]).status == 130
    assert measure(run.path, given=given[half:]).status == 0
    _, nees = calibrate_run(stated)
    dof = len(run.sensor.coefficients)
    assert float(chdtri(dof, 0.9995)) < nees * dof < float(chdtri(dof, 0.0005))


def test_on_a_dividing_head_the_autocollimator_is_asked_for_where_it_is_read(tmp_path: Path):
    folder = Path(shutil.copytree(EXAMPLES / "dividing_head", tmp_path / "head"))
    with (folder / "lab.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    columns = ("a", "b", "autocollimator", "level")
    given = [" ".join(filter(None, (row[name] for name in columns))) + "\n" for row in rows]
    assert {len(line.split()) for line in given} == {3, 4}
    reference = calibrate(folder / "lab.toml").calibration
    done = measure(folder / "lab.toml", "--force", given=given)
    assert done.status == 0
    assert "autocollimator: trim the head until it reads as at 0°, and write down" in done.output
    with (folder / "lab.csv").open(encoding="utf-8", newline="") as file:
        measured = list(csv.DictReader(file))
    for before, after in zip(rows, measured, strict=True):
        assert {k: v and float(v) for k, v in before.items() if k != "position"} == {
            k: v and float(v) for k, v in after.items() if k != "position"
        }
    np.testing.assert_array_equal(
        calibrate(folder / "lab.toml").calibration.values, reference.values
    )


def test_a_turn_by_hand_is_compared_at_the_rate_of_its_own_duration(tmp_path: Path):
    run = simulate_run(write_run("ferraris", tmp_path), 1)
    state_means(run, "sheet.csv", labelled=True)
    given = asked(run, read_off(run, np.random.default_rng(1)))
    seconds, *others = given[6].split()
    rates = [float(x) for x in others[3:]]
    slow = [float(seconds) * 3, *map(float, others[:3]), *(x / 3 for x in rates)]
    lines = [*given[:6], " ".join(map(repr, slow)) + "\n", *given[7:]]
    assert measure(run.path, given=lines).status == 0
    wrong = " ".join([seconds, *others[:3], *(repr(-x) for x in rates)]) + "\n"
    told = measure(run.path, "--force", given=[*given[:6], wrong, *given[6:]])
    assert told.status == 0
    assert "gx reads" in told.output


def test_positions_in_the_hand_are_compared_by_their_norm(tmp_path: Path):
    path = write_run("multi_position", tmp_path)
    text = path.read_text(encoding="utf-8").replace('[sensor.gyro]\nunit = "°/s"\n', "")
    path.write_text(text.replace('white = "0.1 °/√h"', "").replace('gyro = ["gx", "gy", "gz"]', ""))
    run = read(path)
    state_means(run, "sheet.csv", labelled=True)
    run = read(path)
    rng = np.random.default_rng(1)
    ups = np.array([step.up for step in run.steps])  # pyright: ignore[reportAttributeAccessIssue]
    ups = ups + 0.1 * rng.standard_normal(ups.shape)
    g = 9.8073 / 9.80665
    readings = ups / np.linalg.norm(ups, axis=1)[:, None] * g + [0.01, -0.02, 0.03]
    readings += 5e-6 * rng.standard_normal(readings.shape)
    lines = [" ".join(map(repr, row)) + "\n" for row in readings.tolist()]
    told = measure(path, given=["0.5 0.5 0.1\n", *lines])
    assert told.status == 0
    assert "the norm is 7.003 m/s²" in told.output
    calibration = calibrate(path).calibration
    assert calibration.value("ax.k0") / 9.80665 == pytest.approx(0.01, abs=1e-4)

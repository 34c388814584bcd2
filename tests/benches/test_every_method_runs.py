"""From simulation to report: every method on its kind of bench, and one that a package brings.

The run files are made of what kinds and methods declare: a new one is in here without an edit.
"""

import csv
from collections.abc import Iterator
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from scipy.special import chdtri
from tests.base_seeds import evidence, slow
from tests.benches.generated_runs import (
    calibrate_run,
    kind_for,
    read_off,
    simulate_run,
    state_means,
    write_run,
)
from tests.external_bench import register_example_bench
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.methods import METHODS
from inercal.pipeline.budget import budget
from inercal.pipeline.budget.experiment_from_runfile import experiment_from_run
from inercal.pipeline.design.worksheet import build_worksheet, worksheet_csv
from inercal.report import write_report
from inercal.runfile import read

OWN = "tilt_means"
METHOD = pytest.mark.parametrize("method", [*METHODS, OWN])
# The many derivatives of these budgets take seconds.
PLANNED = pytest.mark.parametrize(
    "method", [slow(n) if n in ("rates_and_poses", "ferraris") else n for n in (*METHODS, OWN)]
)
DEVICES = 2
FITTED = pytest.mark.parametrize(
    "method",
    [
        evidence(name)
        if name == "turntable_trajectory"
        else slow(name)
        if kind_for(name).sampled or name == "field_and_rates"
        else name
        for name in METHODS
    ]
    + [OWN],
)


@pytest.fixture(autouse=True)
def known(tmp_path: Path) -> Iterator[None]:
    with register_example_bench(tmp_path):
        yield


@FITTED
def test_errors_of_simulated_sensors_are_as_stated_and_reported(method: str, tmp_path: Path):
    path = write_run(method, tmp_path)
    found = [calibrate_run(simulate_run(path, seed)) for seed in range(DEVICES)]
    dof = sum(len(one.calibration.values) for one, _ in found)
    low, high = (float(chdtri(dof, q)) / dof for q in (0.9995, 0.0005))
    assert low < np.mean([nees for _, nees in found]) < high
    assert sum(one.verdict.grade == "consistent" for one, _ in found) >= len(found) - 1
    outcome = found[0][0]
    page = write_report(outcome, tmp_path / "report.html").read_text(encoding="utf-8")
    assert all(f"{name}<" in page for name in outcome.calibration.sensor.coefficients)
    assert "<svg" in page


@pytest.mark.slow
@PLANNED
def test_the_budget_of_a_plan_is_what_its_estimator_states(method: str, tmp_path: Path):
    run = simulate_run(write_run(method, tmp_path), 1)
    if run.method.unknown_attitudes or run.kind.refuses_budget(run.bench, run.steps):
        with pytest.raises(InputError):
            experiment_from_run(run)
        return
    found = budget(experiment_from_run(run), trials=2)
    np.testing.assert_allclose(found.total.first_order, found.stated, rtol=0.25)


@METHOD
def test_a_filled_worksheet_is_a_table_of_means(method: str, tmp_path: Path):
    more = "turns = 10" if kind_for(method).rows_of_table else ""
    run = simulate_run(write_run(method, tmp_path, more), 1)
    if run.kind.sheet is None or run.method.unknown_attitudes:
        return
    made = build_worksheet(run)
    header, *blank = csv.reader(StringIO(worksheet_csv(made)))
    found: list[float] = []
    for seed in (1, 2):
        readings = read_off(run, np.random.default_rng(seed))
        assert len(blank) == len(readings)
        rows = [[*row, *[""] * (len(header) - len(row))] for row in blank]
        for row, step in zip(rows, made.sheet.rows, strict=True):
            for channel, value in zip(run.sensor.channels, readings[step.label], strict=True):
                row[header.index(channel)] = repr(value)
            if "seconds" in header:
                row[header.index("seconds")] = repr(step.seconds)
        with (tmp_path / "sheet.csv").open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows([header, *rows])
        if not found:
            state_means(run, "sheet.csv", labelled="label" in header)
        found.append(calibrate_run(replace(read(run.path), truth=run.truth))[1])
    dof = len(run.sensor.coefficients) * len(found)
    total = float(np.mean(found)) * dof
    assert float(chdtri(dof, 0.9995)) < total < float(chdtri(dof, 0.0005))


@METHOD
def test_a_key_of_another_kind_is_answered_with_its_kind(method: str, tmp_path: Path):
    path = write_run(method, tmp_path)
    text = path.read_text(encoding="utf-8")
    kind = kind_for(method)
    key = "table_unit" if "table_unit" not in kind.data.model_fields else "arm_rate"
    path.write_text(text.replace("[data]", f'[data]\n{key} = "x"'), encoding="utf-8")
    with refused(key=f"[data] {key}") as refusal:
        read(path)
    assert f'"{kind.name}"' not in str(refusal.value)

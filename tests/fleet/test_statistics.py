import json
from dataclasses import replace
from math import isnan, nan, sqrt
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.fleet.simulated_line import COEFFICIENTS, MG, UNITS, Truth, write_line

from inercal.basics.errors import InputError
from inercal.fleet.control_chart import control_charts
from inercal.fleet.findings import statistics_object, summary_lines
from inercal.fleet.line import SensorRow, read_line
from inercal.fleet.population import Population, read_population
from inercal.fleet.report_page import fleet_page
from inercal.fleet.results import FOLDER, part_paths
from inercal.fleet.statistics import FleetStatistics, capability, fleet_statistics


def population(folder: Path, n: int, truth: Truth | None = None, **more: object) -> Population:
    return read_population(write_line(folder, n, truth, **more), folder / FOLDER)  # type: ignore[arg-type]


def statistics(folder: Path, n: int, truth: Truth | None = None, **more: object) -> FleetStatistics:
    return fleet_statistics(population(folder, n, truth, **more))


def of(found: FleetStatistics, name: str):
    return found.coefficients[COEFFICIENTS.index(name)]


@pytest.mark.slow
def test_scatter_in_truth_is_found_beneath_the_uncertainty(tmp_path: Path):
    truth = Truth(within=2.0, lots=1.5, u=2.0, lot_size=40)
    found = statistics(tmp_path, 4_000, truth)
    within = [one.components.within.sd for one in found.coefficients] / UNITS
    assert_allclose(within, 2.0, rtol=0.08)
    for one, unit in zip(found.coefficients, UNITS, strict=True):
        lots = one.components.lots
        assert lots is not None
        assert lots.low <= 1.5 * unit * 1.1
        assert lots.high >= 1.5 * unit * 0.9
        assert_allclose(one.summary.truth_sd**2, one.summary.sd**2 - one.summary.mean_u**2)
    assert_allclose(of(found, "ax.k0").summary.mean_u / MG, 2.0, rtol=0.02)


def test_scatter_below_the_uncertainty_is_said(tmp_path: Path):
    found = population(tmp_path, 600, Truth(within=0.0, lots=0.0, u=1.0))
    found = fleet_statistics(replace(found, std=1.2 * found.std))
    assert all(isnan(one.summary.truth_sd) for one in found.coefficients)
    assert all(one.components.within.sd == 0 for one in found.coefficients)
    assert all(one.truth is None for one in found.coefficients)
    assert "scatter less" in " ".join(summary_lines(found)[1])


def test_capability_has_the_interval_of_bissell():
    """With n = 30 and Cpk = 1.33: ± 27 %."""
    found = capability(0.0, 1.0, 30, (-3.99, 3.99))
    assert found is not None
    assert_allclose(found.value, 1.33)
    assert_allclose((found.high - found.low) / 2 / found.value, 0.27, atol=0.005)
    assert capability(0.0, 0.0, 30, (-1.0, 1.0)) is None
    assert capability(0.0, nan, 30, (-1.0, 1.0)) is None
    assert capability(0.0, 1.0, 30, None) is None
    one_sided = capability(0.0, 1.0, 30, (-np.inf, 3.0))
    assert one_sided is not None
    assert one_sided.value == 1.0


@pytest.mark.slow
def test_capability_in_truth_is_that_of_the_sensors(tmp_path: Path):
    truth = Truth(within=3.0, lots=0.0, u=3.0)
    bias = of(statistics(tmp_path, 4_000, truth), "ay.k0")
    assert bias.observed is not None
    assert bias.truth is not None
    assert_allclose(bias.truth.value, 12 / 9, rtol=0.06)
    assert_allclose(bias.observed.value, 12 / 9 / sqrt(2), rtol=0.06)
    assert of(statistics(tmp_path / "b", 50, limits=""), "ay.k0").observed is None


@pytest.mark.slow
def test_outliers_are_named_and_do_not_enlarge_the_scatter(tmp_path: Path):
    found = statistics(tmp_path, 2_000, Truth(outliers=10))
    named = [one.id for one in found.outliers]
    assert {f"S{k:06d}" for k in range(10)} <= set(named)
    assert len(named) <= 12
    bias = of(found, "az.k0").summary
    assert bias.sd < 1.1 * bias.robust_sd


def test_few_sensors_have_no_outliers(tmp_path: Path):
    found = statistics(tmp_path, 9, Truth(outliers=1, lot_size=10))
    assert not found.outliers_searched
    assert found.outliers == ()


def test_an_outlier_among_fewer_sensors_than_their_covariance_needs_is_named(tmp_path: Path):
    found = statistics(tmp_path, 20, Truth(outliers=1, lot_size=10))
    assert [one.id for one in found.outliers] == ["S000000"]
    assert found.outliers_by_chance == 0.05


@pytest.mark.slow
def test_drift_and_shift_of_a_station_are_found(tmp_path: Path):
    truth = Truth(lots=0.2, lot_size=25, drift=3.0, station_shift=1.5)
    found = statistics(tmp_path, 2_000, truth)
    chosen = {(one.coefficient, one.of): one for one in found.contrasts if one.significant}
    drift, shift = chosen["ay.k0", "serial order"], chosen["ax.k0", "bench 2"]
    assert abs(drift.value / MG - 3.0) < 3 * drift.std / MG
    assert abs(shift.value / MG - 1.5) < 3 * shift.std / MG
    assert ("ay.k0", "time") in chosen
    assert {name for name, _ in chosen} <= {"ay.k0", "ax.k0"}


@pytest.mark.slow
def test_few_lots_are_no_trend(tmp_path: Path):
    """Lots that differ by chance: without them in the variance, half of all would be trends."""
    wrong = 0
    for seed in range(10):
        found = statistics(tmp_path / str(seed), 600, Truth(lots=2.0, lot_size=60), seed=seed)
        wrong += sum(one.significant for one in found.contrasts if one.of != "time")
    assert wrong <= 2  # of 480


@pytest.mark.slow
def test_control_chart_shows_the_bench_that_changed(tmp_path: Path):
    centre, charts = control_charts(population(tmp_path, 6_000, Truth(chi2_jump=2.0)))
    beyond = {one.station: one.beyond for one in charts}
    assert beyond["bench 0"] > 20
    assert beyond["bench 1"] + beyond["bench 2"] <= 1
    assert_allclose(centre, 1.0, atol=0.15)


@pytest.mark.slow
def test_yield_follows_the_rule(tmp_path: Path):
    found = statistics(tmp_path, 3_000, Truth(within=4.0, u=2.0))
    share = {(one.rule.name, one.rule.factor): one.share for one in found.yields}
    assert share["guarded", 1.0] < share["guarded", 0.83] < share["simple", 1.0] < 1
    assert all(sum(one.counts.values()) == 3_000 for one in found.yields)
    value = found.population.value
    biases = np.abs(value[:, [0, 4, 8]]).max(axis=1) <= 12 * MG
    scales = (value[:, [1, 5, 9]] >= -0.012).all(axis=1) & (value[:, [1, 5, 9]] <= 0.014).all(
        axis=1
    )
    assert_allclose(share["simple", 1.0], np.mean(biases & scales))


def test_lots_and_stations_have_their_own_rows(tmp_path: Path):
    found = statistics(tmp_path, 100, Truth(lot_size=30))
    assert [one.name for one in found.lots] == ["L000", "L001", "L002", "L003"]
    assert [one.summaries[0].n for one in found.lots] == [30, 30, 30, 10]
    first = found.population.value[:30, 0]
    assert_allclose(found.lots[0].summaries[0].median, np.median(first))
    named = {one.id for one in found.outliers}
    kept = [k for k in range(30) if found.population.ids[k] not in named]
    assert_allclose(found.lots[0].summaries[0].sd, np.std(first[kept], ddof=1))
    assert len(found.stations) == 3


@pytest.mark.slow
def test_object_and_page_say_the_same(tmp_path: Path):
    found = statistics(tmp_path, 300, Truth(outliers=2, lot_size=50))
    content = json.loads(json.dumps(statistics_object(found)))
    assert content["sensors"] == 300
    assert len(content["coefficients"]) == 12
    assert content["coefficients"][0]["cpk"]["value"] > 0
    html = fleet_page(found, "line 1")
    assert "<h1>line 1</h1>" in html
    assert all(one.id in html for one in found.outliers)
    assert html.count("<svg") == 4
    assert f"{100 * found.yields[0].share:.4g} %" in html


def test_sensors_without_a_usable_result_are_counted_apart(tmp_path: Path):
    line = write_line(tmp_path, 60, part=10)
    for name, further in (
        ("bad", {"grade": "unreliable"}),
        ("failed", {"status": "failed", "value": None}),
    ):
        write_line(tmp_path / name, 20, part=10, generation=2, further=further)
    # The parts are named by their sensors: the first two of the line are replaced.
    for name, part in zip(("failed", "bad"), part_paths(tmp_path / "bad" / FOLDER), strict=True):
        (tmp_path / FOLDER / part.name).write_bytes(
            (tmp_path / name / FOLDER / part.name).read_bytes()
        )
    more = replace(line, rows=(*line.rows, SensorRow("S999999", "x.csv")))
    found = read_population(more, tmp_path / FOLDER)
    assert found.ids == tuple(row.id for row in line.rows[20:])
    assert found.left_out == {
        "without a result yet": 1, "failed or lost": 10, "not to be relied on": 10
    }  # fmt: skip
    for some, folder in ((replace(line, rows=line.rows[:20]), FOLDER), (line, "none")):
        with pytest.raises(InputError, match="no calibrated sensor"):
            read_population(some, tmp_path / folder)


def test_a_template_that_changed_since_leaves_the_results_readable(tmp_path: Path):
    line = write_line(tmp_path, 60)
    text = (tmp_path / "run.toml").read_text(encoding="utf-8")
    text = text.replace('"six_position"', '"six_position"\ncoefficients = ["bias"]')
    text = text.replace('scale = ["-12000 ppm", "14000 ppm"]', "")
    (tmp_path / "run.toml").write_text(text, encoding="utf-8")
    found = fleet_statistics(read_population(read_line(line.folder), tmp_path / FOLDER))
    assert len(found.coefficients) == 12
    assert sum(one.limits is not None for one in found.coefficients) == 3


@pytest.mark.evidence
def test_100_000_sensors_take_seconds_and_a_small_page(tmp_path: Path):
    from time import process_time

    line = write_line(tmp_path, 100_000, Truth(outliers=50), part=200)
    begin = process_time()
    found = fleet_statistics(read_population(line, tmp_path / FOLDER))
    html = fleet_page(found, "line")
    assert process_time() - begin < 20
    assert len(html.encode()) < 5e6

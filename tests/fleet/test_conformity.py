import csv
from pathlib import Path

import pytest
from tests.fleet.simulated_line import TEMPLATE, write_line
from tests.runfile.key_sweep import EXAMPLES

from inercal.basics.parallel import SerialExecutor
from inercal.estimation.uncertainty.conformity import RESULTS
from inercal.fleet import results
from inercal.fleet.calibration import calibrate_line
from inercal.fleet.latest import latest_results
from inercal.fleet.line import read_line
from inercal.fleet.population import read_population
from inercal.fleet.report_page import fleet_page
from inercal.fleet.station import calibrate_arrival
from inercal.fleet.statistics import fleet_statistics
from inercal.fleet.status import line_status

MEANS = EXAMPLES / "six_position" / "positions.csv"  # az.k0 is 11.442 mg, U = 43 µg
CASES = {"wide": "± 12 mg", "guard": "± 11.45 mg", "beyond": "± 11.43 mg", "far": "± 5 mg"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a line whose sensors differ by their limits."""
    limits = '\n[specification.limits]\nbias = "{limit}"\n'
    (tmp_path / "run.toml").write_text(TEMPLATE + limits, encoding="utf-8")
    with (tmp_path / "sensors.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["id", "recording", "limit"])
        writer.writerows((name, f"{name}.csv", limit) for name, limit in CASES.items())
    text = MEANS.read_text(encoding="utf-8")
    for k, name in enumerate(CASES):  # sensors with equal readings would not be judged
        changed = text.replace("x_p,1.00545", f"x_p,1.0054{5 + k}")
        (tmp_path / f"{name}.csv").write_text(changed, encoding="utf-8")
    return tmp_path


def test_rows_and_status_hold_the_conformity(folder: Path):
    line = read_line(folder)
    with SerialExecutor() as executor:
        calibrate_line(line, executor)
    rows = latest_results(line, folder / results.FOLDER, ["conformity"]).to_pylist()
    assert {row["id"]: row["conformity"] for row in rows} == {
        "wide": "pass",
        "guard": "conditional pass",
        "beyond": "conditional fail",
        "far": "fail",
    }
    found = line_status(line)
    assert found.as_object()["beyond"] == {"beyond": ["az.k0"], "far": ["ay.k0", "az.k0"]}
    assert "far: fail by [specification]: ay.k0, az.k0" in found.attention_lines()
    assert found.as_object()["conformity"] == dict.fromkeys(
        ("pass", "conditional pass", "conditional fail", "fail"), 1
    )


@pytest.mark.slow
def test_limits_that_differ_from_sensor_to_sensor_are_counted_as_judged(folder: Path):
    line = read_line(folder)
    with SerialExecutor() as executor:
        calibrate_line(line, executor)
    found = fleet_statistics(read_population(line, folder / results.FOLDER))
    assert [one.counts for one in found.yields] == [dict.fromkeys(RESULTS, 1)]
    assert found.yields[0].share == 0.25
    assert all(one.observed is None for one in found.coefficients)
    assert "Limits differ" in fleet_page(found, "line")


def test_a_station_passes_what_keeps_the_guard_band(folder: Path):
    line = read_line(folder)
    said = {
        name: calibrate_arrival(line, folder / f"{name}.csv", folder / "fleet") for name in CASES
    }
    assert {name: one.passed for name, one in said.items()} == {
        "wide": True, "guard": False, "beyond": False, "far": False
    }  # fmt: skip
    assert "az.k0" in said["guard"].reason


def test_results_of_an_earlier_version_have_no_conformity(tmp_path: Path):
    import pyarrow.parquet as pq

    line = write_line(tmp_path, 40, part=20)
    for path in (tmp_path / results.FOLDER).glob("part-*.parquet"):
        pq.write_table(pq.read_table(path).drop_columns(["conformity"]), path)
    found = line_status(line)
    assert found.conformity == {}
    assert sum(found.counts.values()) == 40
    assert len(read_population(line, tmp_path / results.FOLDER).ids) == 40

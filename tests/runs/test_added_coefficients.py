"""`also = "auto"`: what it adds, where it stops, and that following the advice gives the same."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.accuracy.ferraris import mems
from tests.accuracy.handheld import Session, record
from tests.base_seeds import evidence, slow
from tests.evidence import auto
from tests.evidence.violation_cells import Cell, case_cells, device_files
from tests.evidence.visibility_model import Files
from tests.methods import platform_devices
from tests.program import run_program
from tests.refusals import refused
from tests.suspects.rate_platform_runs import arguments

from inercal.basics.run_file_advice import Change
from inercal.calibration.files import load, save
from inercal.methods import METHODS
from inercal.pipeline import Outcome, added_coefficients, calibrate
from inercal.pipeline.batch import calibrate_batch
from inercal.runfile.method_section import stated_also
from inercal.runfile.schema import MethodSection

EXAMPLES = Path(__file__).parents[2] / "examples"
CLOSED = [(name, one) for name, method in METHODS.items() for one in method.closed_formulas]


@pytest.fixture
def example(tmp_path: Path) -> Path:
    for name in ("verdict", "dividing_head", "six_position"):
        shutil.copytree(EXAMPLES / name, tmp_path / name)
    return tmp_path / "verdict" / "auto.toml"


def written(files: Files, folder: Path) -> Path:
    for name, content in files.items():
        raw = content.encode() if isinstance(content, str) else content
        (folder / name).write_bytes(raw)
    return folder / "run.toml"


def violated(case: str, violation: str) -> auto.Row:
    """Return the strongest violation of a kind."""
    return max(auto.rows_of(case, violation), key=lambda one: one.eta)


@pytest.mark.slow
def test_what_was_added_is_recorded_and_the_result_is_that_of_an_explicit_list(
    example: Path, tmp_path: Path
):
    outcome = calibrate(example)
    (added,) = outcome.additions
    assert (added.group, added.coefficients) == ("a.k2", ("a.k2",))
    assert {"a.kpp", "harmonic 1"} <= set(added.indistinguishable)
    explicit = calibrate(example, also=["a.k2"])
    assert explicit.additions == ()
    np.testing.assert_array_equal(outcome.calibration.values, explicit.calibration.values)
    np.testing.assert_array_equal(outcome.calibration.covariance, explicit.calibration.covariance)
    before, after = calibrate(example, also=[]).estimate, explicit.estimate
    assert added.chi2_before == before.score_tests.chi2
    assert added.chi2_after == after.score_tests.chi2
    assert (added.dof_before, added.dof_after) == (19, 18)
    file = tmp_path / "kept.calibration.json"
    save(outcome.calibration, file)
    kept = load(file).verdict
    assert kept is not None
    assert kept.additions == outcome.additions


def test_an_addition_that_another_cause_replaces_is_not_consistent(example: Path):
    assert calibrate(example).verdict.grade == "reservations"
    assert calibrate(example, also=["a.k2"]).verdict.grade == "consistent"


@pytest.mark.slow
def test_the_option_sets_it_for_one_run(example: Path, tmp_path: Path):
    plain = example.with_name("left_out.toml")
    ended = run_program("calibrate", plain, "--auto", "--json", "--no-report", "--out", tmp_path)
    (added,) = json.loads(ended.output)["verdict"]["additions"]
    assert added["group"] == "a.k2"
    assert added["chi2_before"] > 5 * added["chi2_after"]
    assert calibrate(plain).additions == ()


@pytest.mark.parametrize(("name", "estimator"), CLOSED)
def test_closed_formulas_refuse_it_by_name(name: str, estimator: str):
    assert estimator in METHODS[name].estimators
    keys = {"name": name, "estimator": estimator, "also": "auto"}
    section = MethodSection.model_validate(keys)
    with refused(key="[method] also", names=(estimator,)):
        stated_also(section, METHODS[name])
    assert stated_also(section.model_copy(update={"also": ("k2",)}), METHODS[name]) == ("k2",)


def test_a_run_that_cannot_have_it_names_the_run_file(example: Path):
    text = example.read_text(encoding="utf-8").replace('also = "auto"', 'estimator = "fourier"')
    example.write_text(text, encoding="utf-8")
    with refused(key="[method] also", names=("fourier",), file=example):
        calibrate(example, also="auto")


def test_a_batch_refuses_it():
    up = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    readings = {f"acc_{axis}": up[None, :, k] * np.ones((2, 1)) for k, axis in enumerate("xyz")}
    with refused(key="[method] also"):
        calibrate_batch(
            {"position": ["x_p", "x_a", "y_p", "y_a", "z_p", "z_a"], **readings},
            method={"name": "six_position", "also": "auto"},
            sensor={"accelerometer": {"unit": "g"}},
            bench={"gravity": "9.80665 m/s² ± 0.001 m/s²", "tilt": "0.1 °"},
            label="position",
            sd={"accelerometer": "0.2 mg"},
        )


def two_violations(tmp_path: Path) -> Path:
    """Return a run of gyros with an asymmetry and, far more visible, a cubic term."""
    row, other = (violated("rates_and_poses", one) for one in ("scale_prime", "scale3"))
    here = auto.find_case(row.case)
    values = here.draw(np.random.default_rng(1))
    for change in (row.change, {n: 8 * by for n, by in other.change.items()}):
        values |= {name: values.get(name, 0.0) + by for name, by in change.items()}
    return written(here.files(values, np.random.default_rng(2), None), tmp_path)


@pytest.mark.slow
def test_several_are_added_and_each_is_what_the_verdict_advises(tmp_path: Path):
    run_file, also = two_violations(tmp_path), list[str]()
    found = calibrate(run_file, also="auto")
    assert [one.group for one in found.additions] == ["scale3", "scale_prime"]
    first, second = found.additions
    assert first.chi2_after == second.chi2_before > 2 * second.chi2_after
    outcome = calibrate(run_file)
    while (best := outcome.verdict.best) is not None:
        also.append(best.name)
        outcome = calibrate(run_file, also=also)
    assert also == ["scale3", "scale_prime"]
    np.testing.assert_array_equal(outcome.calibration.values, found.calibration.values)


@pytest.mark.slow
def test_it_stops_after_the_last_that_is_allowed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(added_coefficients, "MOST_ADDITIONS", 1)
    found = calibrate(two_violations(tmp_path), also="auto")
    assert [one.group for one in found.additions] == ["scale3"]
    assert found.verdict.best is not None


@pytest.mark.slow
def test_half_of_the_degrees_of_freedom_are_kept(tmp_path: Path):
    row = violated("multi_position", "k2")
    row = replace(row, size=10 * row.size)
    files, _ = row.device(0)
    for rows, groups in ((18, ["k2"]), (14, [])):
        lines = str(files["means.csv"]).splitlines(keepends=True)[: 1 + rows]
        run_file = written({**files, "means.csv": "".join(lines)}, tmp_path)
        found = calibrate(run_file, also="auto")
        assert [one.group for one in found.additions] == groups
    assert found.verdict.best is not None
    assert calibrate(run_file, also=["k2"]).estimate.converged


@pytest.mark.slow
def test_coefficients_of_temperature_are_left_to_their_orders(example: Path):
    run_file = example.parents[1] / "six_position" / "soaks.toml"
    table = run_file.with_suffix(".csv")
    lines = table.read_text(encoding="utf-8").splitlines(keepends=True)
    # Each position at all temperatures: the temperature is no drift over the run.
    table.write_text("".join((*lines[:3], *sorted(lines[3:]))), encoding="utf-8")
    found = calibrate(run_file, also="auto")
    best = found.verdict.best
    assert found.additions == ()
    assert best is not None
    assert "_dT" in best.name
    assert set(best.components) <= set(METHODS["six_position"].possible(found.calibration.sensor))


@pytest.mark.parametrize(
    ("case", "violation", "key"),
    [
        evidence("centrifuge_norm", "tilt", "tilt"),
        slow("centrifuge_norm", "radius", "gravity"),  # which explains the same
        evidence("ship_multi_angle", "rate", "rate_error"),
        ("rates_and_poses", "latitude", "latitude"),
        evidence("turntable_discrete", "lean of the base", "lean"),
        ("tumble", "third harmonic of the head", "harmonics"),
    ],
)
def test_a_cause_at_the_bench_is_proposed_and_not_fitted(
    case: str, violation: str, key: str, tmp_path: Path
):
    cell = next(one for one in case_cells(case) if (one.violation, one.at) == (violation, "η = 6"))
    run_file = written(device_files(Cell(**{**vars(cell), "size": 2 * cell.size}), 1)[0], tmp_path)
    found = calibrate(run_file, also="auto")
    assert found.additions == ()
    (change,) = _advice_on_suspect(found)
    assert (change.section, change.key) == ("bench", key)


def _advice_on_suspect(outcome: Outcome) -> tuple[Change, ...]:
    suspect = outcome.verdict.suspect
    assert suspect is not None
    assert suspect.kind == "bench"
    return next(one.changes for one in outcome.verdict.advice if one.reason == suspect.name)


def sensitive_to_g() -> dict[str, Any]:
    """Return a table of rates in six settings, of gyros that are sensitive to acceleration."""
    terms = ("bias", "scale", "delta_o", "delta_p", "g_i", "g_p", "g_o")
    table, rng = platform_devices.Table(2e-5, 1e-5, 5e-6, 0.0, 4e-4), np.random.default_rng(3)
    made = platform_devices.devices(platform_devices.MID_SIX, "C", table, terms, 1, rng)
    return {
        "axis": [row.name for row in made.rows],
        "rate": np.degrees([row.rate for row in made.rows]),
        "seconds": [row.seconds for row in made.rows],
        **dict(zip(("gx", "gy", "gz"), np.degrees(made.reading[0]).T, strict=True)),
    }


@pytest.mark.slow
def test_a_sensitivity_of_gyros_to_acceleration_is_added_on_a_rate_table_of_known_arm():
    stated = {"rate_asymmetry": "10 ppm", "rate_stability": "5 ppm", "latitude": "50 °"}
    keys: dict[str, Any] = arguments({"also": "auto"}, stated) | {"sd": {"gyro": "4 °/h"}}
    without = calibrate(sensitive_to_g(), **keys)
    assert without.additions == ()
    (advice,) = (one for one in without.verdict.advice if one.reason == "g")
    assert "[bench] arm" in advice.action
    keys["bench"] |= {"arm": "5 mm"}
    assert [one.group for one in calibrate(sensitive_to_g(), **keys).additions] == ["g"]


@pytest.mark.slow
def test_an_addition_by_which_the_noise_of_the_rests_decreases_too_is_kept():
    """The tremor that the rests show and the gyros seem to share is then their sensitivity."""
    rng = np.random.default_rng([1, 63])
    session = Session(positions=20, latitude=np.radians(47.0), gravity_sd=2e-4, tremor_deg=0.02)
    made = record(mems(rng), session, rng)
    log = np.array(made.data[0])
    log[:, 3:] += np.radians(0.05) / 9.81 * log[:, :3]
    found = calibrate(
        {"t": made.time, **dict(zip(("ax", "ay", "az", "gx", "gy", "gz"), log.T, strict=True))},
        method={"name": "multi_position", "also": "auto"},
        sensor={"accelerometer": {"unit": "m/s²"}, "gyro": {"unit": "rad/s"}},
        bench={"latitude": "47 ° ± 0.01 °", "gravity": f"{session.gravity} m/s² ± 0.2 mm/s²"},
        time="t",
        accelerometer=["ax", "ay", "az"],
        gyro=["gx", "gy", "gz"],
    )
    assert "g" in [one.group for one in found.additions]

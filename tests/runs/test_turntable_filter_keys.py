"""[method.filter]: what an operator sets in the filters of turntable_kalman."""

import json
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.accuracy import turntable
from tests.methods.turntable_cases import BENCH, observations, sensor, truth
from tests.refusals import refused
from tests.runs.test_turntable_runs import copy_run, simulate_recording

from inercal.basics.errors import NotObserved
from inercal.cli.app import app
from inercal.methods.turntable_kalman import METHOD, method_with
from inercal.methods.turntable_kalman.filter_config import FILTER_CONFIGS
from inercal.pipeline import Outcome, calibrate
from inercal.pipeline.design.turntable_path import turntable_path_sheet
from inercal.runfile import Run, read

RATE = ('rate = "100 Hz"', 'rate = "50 Hz"')
DEFAULTS = {
    "velocity_sd": "0.0001 mm/s",
    "epoch": "0.1 s",
    "bias_drift": True,
    "table_states": "whole",
    "initial": {
        "gyro_bias": "1 °/s",
        "gyro_scale": "2 %",
        "gyro_misalignment": "20 mrad",
        "accelerometer_bias": "30 mg",
        "accelerometer_scale": "20000 ppm",
        "accelerometer_misalignment": "0.02 rad",
    },
}
Keys = dict[str, Any]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the example's recording."""
    made = tmp_path_factory.mktemp("example")
    simulate_recording(copy_run(made, RATE))
    return made


@pytest.fixture(scope="module")
def nominal(folder: Path) -> Outcome:
    """Return what that recording is calibrated to without keys."""
    return calibrate(folder / "mimu.toml")


def with_keys(folder: Path, keys: Keys, **method: Any) -> Run:
    return read(folder / "mimu.toml", {"filter": keys, **method})


def ratios(one: Outcome, other: Outcome) -> np.ndarray:
    """Return the standard deviations of one over those of the other."""
    return one.calibration.std / other.calibration.std


def deviations(one: Outcome, other: Outcome) -> np.ndarray:
    """Return the differences of the coefficients in standard deviations."""
    return np.abs(one.calibration.values - other.calibration.values) / other.calibration.std


def nis(outcome: Outcome) -> list[float]:
    """Return the NIS per component of gyros and accelerometers."""
    return [group.chi2 / group.dof for group in outcome.estimate.groups]


@pytest.mark.slow
def test_defaults_that_are_stated_change_no_bit(folder: Path, nominal: Outcome):
    stated = calibrate(with_keys(folder, DEFAULTS)).calibration
    assert stated.values.tobytes() == nominal.calibration.values.tobytes()
    assert stated.covariance.tobytes() == nominal.calibration.covariance.tobytes()
    assert "filter keys changed" not in stated.conditions
    assert stated.conditions == nominal.calibration.conditions


@pytest.mark.slow
@pytest.mark.parametrize(
    ("estimator", "keys"),
    [
        ("drift", {"velocity_sd": "1 mm/s", "bias_drift": True, "table_states": "lean"}),
        ("paper", {"readback_sd": "10 ″", "bias_drift": False, "table_states": "exact"}),
    ],
)
def test_each_estimator_begins_with_its_own_defaults(folder: Path, estimator: str, keys: Keys):
    own = calibrate(read(folder / "mimu.toml", {"estimator": estimator})).calibration
    stated = calibrate(with_keys(folder, keys, estimator=estimator)).calibration
    assert stated.values.tobytes() == own.values.tobytes()
    assert "filter keys changed" not in stated.conditions


@pytest.mark.slow
def test_a_larger_initial_deviation_of_scale_shows_where_data_do_not_dominate(
    folder: Path, nominal: Outcome
):
    # Data give scale factors to some ppm of the 2 % before them: a larger P₀ is a share below
    # 1e-5 of the variance; a P₀ of the size of the uncertainty halves the variance.
    wider = calibrate(with_keys(folder, {"initial": {"gyro_bias": "2 °/s"}}))
    assert np.max(np.abs(ratios(wider, nominal) - 1)) < 1e-4
    at = nominal.calibration.sensor.coefficients.index("gx.bias")
    sd = float(nominal.calibration.std[at])
    narrow = calibrate(
        with_keys(folder, {"initial": {"gyro_bias": f"{np.degrees(2 * sd) * 3600:.6g} °/h"}})
    )
    # 1/(1/σ² + 1/(2σ)²) is 0.8 σ². The bias is the mean over the run, and part of it is drift.
    assert 0.8 < ratios(narrow, nominal)[at] < 0.97


@pytest.mark.slow
def test_an_initial_deviation_below_what_data_give_is_refused(folder: Path):
    keys = {"initial": {"accelerometer_scale": "0.2 ppm"}}
    with pytest.raises(NotObserved) as refusal:
        calibrate(with_keys(folder, keys))
    assert {word[-2:] for text in refusal.value.directions for word in text.split()[-1:]} == {"k1"}


@pytest.mark.slow
def test_a_small_r_makes_the_innovations_large_and_the_verdict_says_so(tmp_path: Path):
    run = copy_run(tmp_path, RATE, ('noise = "0.5 ″"', 'noise = "10 ″"'))
    simulate_recording(run)
    as_stated = calibrate(run)
    small = calibrate(with_keys(tmp_path, {"readback_sd": "1 ″"}))
    assert max(nis(as_stated)) < 1.05
    # R is a hundredth of its variance; the gyros' noise is beside it.
    assert min(nis(small)) > 4
    assert as_stated.verdict.word == "consistent"
    assert small.verdict.word == "not to be relied on"
    assert all(group.enlarged for group in small.estimate.groups)


@pytest.mark.slow
def test_a_large_r_of_velocity_makes_their_innovations_small(folder: Path, nominal: Outcome):
    loose = calibrate(with_keys(folder, {"velocity_sd": "10 mm/s"}))
    assert nis(loose)[1] < 0.6 < nis(nominal)[1]
    assert nis(loose)[0] == nis(nominal)[0]  # the gyros' filter has no velocity


@pytest.mark.slow
def test_the_epoch_is_the_time_between_observations(folder: Path, nominal: Outcome):
    gyros = nominal.estimate.courses[0]
    for epoch in (0.06, 0.2):
        other = calibrate(with_keys(folder, {"epoch": f"{epoch} s"}))
        steps = np.diff(other.estimate.courses[0].time)
        assert np.median(steps) == pytest.approx(epoch)
        assert gyros.time.size / other.estimate.courses[0].time.size == pytest.approx(
            epoch / 0.1, rel=0.01
        )
        assert np.max(deviations(other, nominal)) < 0.6
        assert ratios(other, nominal) == pytest.approx(1, abs=0.02)


@pytest.mark.slow
def test_states_are_as_the_keys_have_them(folder: Path):
    names: dict[str, set[str]] = {}
    drifts: dict[str, bool] = {}
    for states, drift in (("whole", False), ("lean", True), ("exact", True)):
        outcome = calibrate(with_keys(folder, {"table_states": states, "bias_drift": drift}))
        gyros, accelerometers = (set(course.names) for course in outcome.estimate.courses)
        names[states] = {
            name for name in gyros | accelerometers if "." not in name and "drift[" not in name
        }
        # Without drift its states are placeholders of no variance.
        drifts[states] = any(
            course.std[:, course.names.index(name)].any()
            for course in outcome.estimate.courses
            for name in course.names
            if "drift[" in name
        )
    assert {"latency", "lean_x", "square_1"} <= names["whole"]
    assert {"latency", "lean_x", "hold_x"} <= names["lean"]
    assert "square_1" not in names["lean"]
    assert names["exact"] == set()
    assert drifts == {"whole": False, "lean": True, "exact": True}


@pytest.mark.slow
def test_the_sources_r_that_is_replaced_is_a_test_again(folder: Path):
    lines = [
        calibrate(with_keys(folder, keys, estimator="drift")).estimate.notes
        for keys in (
            {"epoch": "0.2 s"},
            {"readback_sd": "0.6 ″"},
            {"readback_sd": "0.6 ″", "velocity_sd": "0.01 mm/s"},
        )
    ]
    untested = [sum("does not test noise and table" in note for note in notes) for notes in lines]
    assert untested == [2, 1, 0]


@pytest.mark.slow
def test_values_in_force_are_in_conditions_report_and_json(
    folder: Path, nominal: Outcome, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert "epoch 0.1 s" in nominal.calibration.conditions["filter"]
    text = (folder / "mimu.toml").read_text(encoding="utf-8")
    path = folder / "keys.toml"
    path.write_text(f'{text}\n[method.filter]\nepoch = "0.2 s"\n', encoding="utf-8")
    app(["calibrate", str(path), "--out", str(tmp_path), "--json"], standalone_mode=False)
    conditions = json.loads(capsys.readouterr().out)["conditions"]
    assert conditions["filter keys changed"] == "epoch 0.2 s (default 0.1 s)"
    assert "epoch 0.2 s" in conditions["filter"]
    page = tmp_path / "keys.report.html"
    assert "epoch 0.2 s (default 0.1 s)" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("keys", "key"),
    [
        ({"readback_sd": "-1 ″"}, "readback_sd"),
        ({"readback_sd": "0 ″"}, "readback_sd"),
        ({"readback_sd": "4 mm"}, "readback_sd"),
        ({"readback_sd": "0.05 ″"}, "readback_sd"),
        ({"readback_sd": "2 °"}, "readback_sd"),
        ({"velocity_sd": "0 m/s"}, "velocity_sd"),
        ({"velocity_sd": "1 mm"}, "velocity_sd"),
        ({"velocity_sd": "1 km/s"}, "velocity_sd"),
        ({"epoch": "0 s"}, "epoch"),
        ({"epoch": "0.1 Hz"}, "epoch"),
        ({"epoch": "1 ms"}, "epoch"),
        ({"epoch": "2 s"}, "epoch"),
        ({"epoch": "0.05 s"}, "epoch"),  # 2.5 samples at 50 Hz
        ({"initial": {"gyro_bias": "-1 °/h"}}, "initial.gyro_bias"),
        ({"initial": {"gyro_bias": "1 mg"}}, "initial.gyro_bias"),
        ({"initial": {"accelerometer_scale": "200 %"}}, "initial.accelerometer_scale"),
        ({"initial": {"attitude": "90 °"}}, "initial.attitude"),
    ],
)
def test_a_wrong_value_is_one_line(folder: Path, keys: Keys, key: str):
    *more, name = key.split(".")
    with refused(key=f"[{'.'.join(['method', 'filter', *more])}] {name}") as refusal:
        with_keys(folder, keys)
    assert "\n" not in str(refusal.value)


def test_an_epoch_between_samples_is_refused_where_only_the_recording_tells(folder: Path):
    text = (folder / "mimu.toml").read_text(encoding="utf-8")
    assert RATE[1] in text
    path = folder / "no_rate.toml"
    filter_key = '\n[method.filter]\nepoch = "0.05 s"\n'
    path.write_text(text.replace(RATE[1], "") + filter_key, encoding="utf-8")
    with refused(key="[method.filter] epoch", file=path):
        calibrate(path)


@pytest.mark.parametrize("method", ["turntable_discrete", "turntable_trajectory"])
def test_other_methods_refuse_the_section_by_name(folder: Path, method: str):
    with refused(key="[method.filter]") as refusal:
        with_keys(folder, {"epoch": "0.2 s"}, name=method)
    assert method in str(refusal.value)


def test_keys_of_what_is_not_estimated_are_refused(folder: Path, tmp_path: Path):
    with refused(key="[method.filter.initial] gyro_bias"):
        with_keys(
            folder,
            {"initial": {"gyro_bias": "1 °/h"}},
            coefficients=["k0", "k1", "scale", "misalignment"],
        )
    no_drift = ("bias_instability", "# bias_instability")
    copy_run(tmp_path, no_drift)
    with refused(key="[method.filter] bias_drift"):
        with_keys(tmp_path, {"bias_drift": False})


@pytest.mark.slow
def test_the_plan_is_worked_out_with_the_keys(folder: Path):
    plain, loose = (
        turntable_path_sheet(with_keys(folder, keys)) for keys in ({}, {"readback_sd": "20 ″"})
    )
    wider = [
        b.std / a.std for a, b in zip(plain.expected, loose.expected, strict=True) if a.std > 0
    ]
    assert min(wider) > 0.999
    assert max(wider) > 1.2


@pytest.mark.slow
@pytest.mark.parametrize("epoch", [0.05, 0.2])
def test_nees_is_within_its_band_at_other_epochs(seed: int, epoch: float):
    devices, path = 12, [
        ("warm-up", (0, 0, 0), 40.0),
        *turntable.positions(20.0),
        *turntable.turns(720.0, 30.0, back=True),
    ]  # fmt: skip
    made = turntable.draw(1000 * seed, devices, path)
    config = FILTER_CONFIGS["full"]._replace(epoch=epoch)
    method, of = method_with(config, "full"), sensor()
    estimate = method.estimator("full")(observations(made, of), of, BENCH, ())
    p = len(of.coefficients)
    off = estimate.value[:, :p] - truth(made, of.coefficients)
    nees = [
        error @ np.linalg.solve(covariance[:p, :p], error) / p
        for error, covariance in zip(off, estimate.covariance, strict=True)
    ]
    assert abs(np.mean(nees) - 1) < 3 * sqrt(2 / (p * devices))


def test_the_method_without_keys_stays_as_it_is():
    changed = method_with(FILTER_CONFIGS["full"]._replace(epoch=0.2), "full")
    assert changed.name == METHOD.name
    assert changed.estimators["drift"] is METHOD.estimators["drift"]
    assert changed.estimators["full"] is not METHOD.estimators["full"]

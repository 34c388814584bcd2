"""Run files with [environment]: from a chamber in simulation to a calibration in use."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import chdtri
from tests.refusals import refused
from tests.runfile.key_sweep import example, toml

import inercal
from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS
from inercal.calibration import Calibration
from inercal.calibration.display import temperature_curves
from inercal.calibration.explanation import UNDETECTABLE
from inercal.calibration.files import load, save
from inercal.pipeline import (
    Outcome,
    apply,
    apply_data_columns,
    calibrate,
    simulate,
    simulate_files,
)
from inercal.pipeline.run_calibration import calibrate_run
from inercal.recordings import Recording
from inercal.recordings.io.write import write_recordings
from inercal.runfile import read

HERE = Path(__file__).parent
EXAMPLES = HERE.parents[1] / "examples"
TEMPERATURES = '["-40 °C", "-20 °C", "0 °C", "25 °C", "45 °C", "65 °C", "85 °C"]'
SOAKS, RAMP = ((HERE / f"{name}_run.toml").read_text(encoding="utf-8") for name in ("soak", "ramp"))


def written(folder: Path, text: str, changes: Mapping[str, str] | None = None) -> Path:
    """Write a run file with changes."""
    for old, new in (changes or {}).items():
        assert old in text
        text = text.replace(old, new)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "run.toml"
    path.write_text(text, encoding="utf-8")
    return path


def simulated(
    folder: Path, text: str, changes: Mapping[str, str] | None = None, seed: int = 3
) -> Path:
    """Write a run file with changes and its simulated recording."""
    path = written(folder, text, changes)
    run = read(path)
    files = simulate_files(run, seed)
    write_recordings({run.file(name): one for name, one in files.items()})
    return path


@pytest.fixture(scope="module")
def soaked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Outcome]:
    path = simulated(tmp_path_factory.mktemp("soaks"), SOAKS)
    return path, calibrate(path)


def truth_of(path: Path, calibration: Calibration) -> np.ndarray:
    stated = read(path).truth
    return np.array([stated.get(name, 0.0) for name in calibration.sensor.coefficients])


@pytest.mark.slow
def test_soaks_of_six_positions_recover_the_truth_with_the_orders_that_made_it(
    soaked: tuple[Path, Outcome],
):
    path, outcome = soaked
    found, fit = outcome.calibration, outcome.temperature_fit
    assert fit is not None
    assert fit.orders == {"f": (3, 2, 1)}
    assert outcome.verdict.word == "consistent"
    error = found.values - truth_of(path, found)
    nees = error @ np.linalg.solve(found.covariance, error)
    assert 12.8 < nees < 64.0  # 0.05 and 99.9 % points of χ² of 33
    assert len(fit.soaks) == 7
    assert len(fit.left_out) == 7
    assert all(one.ratio < 1.5 for one in fit.left_out if one.inside)


@pytest.mark.slow
def test_a_report_shows_curves_and_the_soaks_left_out(soaked: tuple[Path, Outcome], tmp_path: Path):
    page = Path(inercal.write_report(soaked[1], tmp_path / "r.html")).read_text(encoding="utf-8")
    section = page[page.index('id="temperature"') :]
    assert section.index("<svg") < section.index("</section>")
    assert "ax.delta_o" in section[: section.index("</section>")]


def test_curves_are_the_polynomials_with_their_covariance(soaked: tuple[Path, Outcome]):
    found = soaked[1].calibration
    kelvin = np.array([-30.0, 60.0]) + ZERO_CELSIUS
    curve = next(one for one in temperature_curves(found, kelvin) if one.name == "ax.k0")
    dT = kelvin - found.sensor.reference_temperature
    powers = {"ax.k0": 0, "ax.k0_dT": 1, "ax.k0_dT2": 2, "ax.k0_dT3": 3}
    names = found.sensor.coefficients
    by = np.array([[t ** powers[n] if n in powers else 0.0 for n in names] for t in dT])
    np.testing.assert_allclose(curve.value, by @ found.values, rtol=1e-12)
    variance = np.diag(by @ found.covariance @ by.T)
    np.testing.assert_allclose(curve.std**2, variance, rtol=1e-9)


@pytest.mark.slow
def test_apply_refuses_two_kelvin_beyond_unless_asked_and_then_marks(
    soaked: tuple[Path, Outcome], tmp_path: Path
):
    path, outcome = soaked
    save(outcome.calibration, tmp_path / "c.json")
    calibration = load(tmp_path / "c.json")
    inside = apply(calibration, path)
    assert "extrapolated" not in inside.readback
    ends = '"85 °C"', '"87.2 °C"'
    hot = simulated(tmp_path / "hot", SOAKS, {", ".join(('"65 °C"', ends[0])): ends[1]})
    with refused(InputError, key="[data] temperature") as refusal:
        apply(calibration, hot)
    assert "87." in str(refusal.value)
    corrected = apply(calibration, hot, extrapolate=True)
    assert corrected.temperature is not None
    high = outcome.calibration.validity.temperature[1]  # type: ignore[union-attr,index]
    beyond = corrected.temperature > high + 1
    assert beyond.any()
    np.testing.assert_array_equal(corrected.readback["extrapolated"] == 1, beyond)
    (count,) = (f.message for f in corrected.findings if f.what == "extrapolation")
    assert count.startswith(f"{beyond.sum()} samples")


def test_curves_refuse_two_kelvin_beyond(soaked: tuple[Path, Outcome]):
    found = soaked[1].calibration
    assert found.validity is not None
    assert found.validity.temperature is not None
    high = found.validity.temperature[1]
    temperature_curves(found, np.array([high + 0.9]))
    with refused(InputError, key="temperature"):
        temperature_curves(found, np.array([high + 2.0]))


@pytest.mark.slow
def test_orders_that_are_too_low_are_named(soaked: tuple[Path, Outcome], tmp_path: Path):
    run = written(
        soaked[0].parent / "low", SOAKS, {'"auto"': "[1, 0, 0]", "soaks.npz": "../soaks.npz"}
    )
    outcome = calibrate_run(read(run), advise=False)
    assert outcome.estimate.chi2 / outcome.estimate.dof > 100
    (found,) = [one for one in outcome.findings if one.what == "temperature_order"]
    assert '"auto"' in found.message
    assert outcome.temperature_fit is not None
    highest = replace(outcome.temperature_fit, orders={"f": (3, 2, 1)})
    (found,) = [one for one in highest.findings if one.what == "temperature_order"]
    assert '"auto"' not in found.message


@pytest.mark.slow
def test_shared_errors_of_soaks_are_in_the_uncertainty(soaked: tuple[Path, Outcome]):
    path, outcome = soaked
    bare = written(
        path.parent / "bare",
        SOAKS,
        {'temperature_sd = "0.1 K"\n': "", "soaks.npz": "../soaks.npz", '"auto"': "[3, 2, 1]"},
    )
    less = calibrate(bare).calibration
    names = [n for n in less.sensor.coefficients if n.endswith("k0_dT")]
    for name in names:
        assert less.uncertainty(name) < outcome.calibration.uncertainty(name)


@pytest.mark.slow
def test_a_bias_that_hangs_on_the_direction_shows_as_a_loop(tmp_path: Path):
    there_and_back = '["0 °C", "20 °C", "40 °C", "60 °C", "40 °C", "20 °C", "0 °C"]'
    path = simulated(tmp_path, SOAKS, {TEMPERATURES: there_and_back, '"auto"': "[3, 2, 1]"})
    run = read(path)
    recording = simulate(run, 3)
    assert recording.temperature is not None
    later = np.arange(recording.time.size) > recording.time.size / 2
    changed = recording.data.copy()
    changed[later, 0] -= 2 * 400e-6 * 9.80665  # half a loop of 400 µg
    columns = apply_data_columns(run, replace(recording, data=changed))
    write_recordings({run.file(run.data.file): columns})
    fit = calibrate(path).temperature_fit
    assert fit is not None
    assert len(fit.loops) == 2  # the first soak was reached from nowhere
    half = np.array([one.half for one in fit.loops]).mean(axis=0) / (1e-6 * 9.80665)
    # The fit takes a part of the loop into its coefficients.
    assert 200 < half[0] < 500
    assert np.abs(half[1:]).max() < 100


REFUSED = [
    ({"soaks.npz": "../soaks.npz", '"auto"': "[4, 0, 0]"}, "[method] temperature_order"),
    ({"soaks.npz": "../soaks.npz", '"auto"': '"auto"\nalso = ["k0_dT2"]'}, "[method] also"),
    ({"soaks.npz": "../soaks.npz", 'temperature = "temp"\n': ""}, "[data] temperature"),
    ({'temperature_order = "auto"\n': ""}, "[environment]"),
    (
        {'accelerometer_repeatability = "50 µg"': 'gyro_repeatability = "5 °/h"'},
        "[environment] gyro_repeatability",
    ),
    ({'temperature_sd = "0.1 K"': 'warm_up = "300 s"'}, "[environment] warm_up"),
    ({'temperature_sd = "0.1 K"': 'temperature_sd = "-0.1 K"'}, "[environment] temperature_sd"),
]


@pytest.mark.parametrize(("changes", "key"), REFUSED, ids=[key for _, key in REFUSED])
def test_a_key_that_cannot_be_used_is_refused(
    soaked: tuple[Path, Outcome], changes: dict[str, str], key: str, tmp_path: Path
):
    folder = soaked[0].parent / "refused"
    with refused(InputError, key=key):
        calibrate(written(folder, SOAKS, changes))


@pytest.mark.parametrize(
    ("temperatures", "order", "key"),
    [
        ('["0 °C", "20 °C", "40 °C"]', "[3, 1, 0]", "[method] temperature_order"),
        ('["20 °C", "24 °C", "28 °C"]', "[1, 0, 0]", "[data] temperature"),
        ('["20 °C", "20 °C", "20 °C"]', '"auto"', "[data] temperature"),
    ],
    ids=["order of as many soaks", "span below 10 K", "constant"],
)
def test_temperatures_that_do_not_support_the_orders_are_refused(
    temperatures: str, order: str, key: str, tmp_path: Path
):
    path = simulated(tmp_path, SOAKS, {TEMPERATURES: temperatures, '"auto"': order})
    with refused(InputError, key=key):
        calibrate(path)


def test_a_ramp_up_and_down_finds_the_lag_and_the_biases(tmp_path: Path):
    path = simulated(tmp_path, RAMP, {'kind = "ramp"': 'kind = "ramp"\nlag = "20 s"'})
    free = written(tmp_path, RAMP)
    outcome = calibrate(free)
    estimate = outcome.estimate
    lag = estimate.value[estimate.names.index("lag")]
    assert abs(lag - 20) < 1.5
    found = outcome.calibration
    error = found.values - truth_of(path, found)
    nees = error @ np.linalg.solve(found.covariance, error)
    assert 1.8 < nees < 34.0  # 0.05 and 99.95 % points of χ² of 12
    assert any("dT/dt" in note for note in found.notes)
    assert "hysteresis of gx" in found.conditions
    assert not {one.what for one in outcome.findings} & {"one_way", "drift_in_time"}


@pytest.mark.slow
@pytest.mark.parametrize("lag", ["20 s", "-20 s"])
def test_apply_uses_a_lag_or_a_lead_and_warns_if_none_is_stated(lag: str, tmp_path: Path):
    stated = {'kind = "ramp"': f'kind = "ramp"\nlag = "{lag}"'}
    path = simulated(tmp_path, RAMP, stated)
    found = calibrate(written(tmp_path, RAMP)).calibration
    assert abs(float(found.conditions["lag of the temperature"].split()[0]) - int(lag[:-2])) < 1.5

    def left(corrected: Recording) -> float:
        """Return the difference between rising and falling temperature, rad/s."""
        assert corrected.temperature is not None
        rising = np.gradient(corrected.temperature) > 0
        return abs(corrected.data[rising, 0].mean() - corrected.data[~rising, 0].mean())

    without = apply(found, path)
    assert [one.what for one in without.findings if one.severity == "warning"] == ["lag"]
    corrected = apply(found, written(tmp_path, RAMP, stated))
    assert not [one for one in corrected.findings if one.what == "lag"]
    assert left(corrected) < 0.25 * left(without)


def test_a_lag_that_is_stated_exactly_is_not_taken_for_hysteresis(tmp_path: Path):
    stated = {'kind = "ramp"': 'kind = "ramp"\nlag = "20 s"'}
    outcome = calibrate(simulated(tmp_path, RAMP, stated))
    assert "lag" not in outcome.estimate.names
    half = float(outcome.calibration.conditions["hysteresis of gx"].split()[0])
    # b' Ṫ τ of gx is 84 °/h; the noise of a bin is about 10 °/h.
    assert abs(half) < 40


def test_a_bias_against_the_rate_of_the_temperature_is_found_and_corrected(tmp_path: Path):
    changes = {
        '"gy.bias_dT"': '"gx.bias_dTdt" = "40 °/h/(K/min)"\n"gy.bias_dT"',
        "[3, 0, 0]": '[3, 0, 0]\nalso = ["bias_dTdt"]',
    }
    path = simulated(tmp_path, RAMP, changes)
    outcome = calibrate(path)
    found = outcome.calibration
    assert "lag" not in outcome.estimate.names
    error = (found.values - truth_of(path, found)) / found.std
    at = found.sensor.coefficients.index("gx.bias_dTdt")
    assert abs(error[at]) < 4
    corrected = apply(found, path)
    assert corrected.temperature is not None
    rising = np.gradient(corrected.temperature) > 0
    left = corrected.data[rising, 0].mean() - corrected.data[~rising, 0].mean()
    # The term alone makes 2 · 40 °/h/(K/min) · 4.7 K/min of difference.
    assert abs(left) < 20 * np.pi / 180 / 3600


ONE_WAY = {', "60 °C", "-10 °C"]': ', "60 °C"]', "4.666 K/min": "2.333 K/min"}


def test_a_ramp_one_way_says_what_shifts_it(tmp_path: Path):
    path = simulated(tmp_path, RAMP, ONE_WAY)
    outcome = calibrate(path)
    said = {one.what: one.message for one in outcome.findings}
    assert "b′ Ṫ τ" in said["one_way"]
    assert "drift_in_time" in said
    assert outcome.verdict.grade != "consistent"
    lag = {'kind = "ramp"': 'kind = "ramp"\nlag = "20 s ± 2 s"'}
    known = calibrate(written(tmp_path, RAMP, ONE_WAY | lag))
    assert "one_way" not in {one.what for one in known.findings}
    warm = written(tmp_path, RAMP, ONE_WAY | {'kind = "ramp"': 'kind = "ramp"\nwarm_up = "300 s"'})
    with refused(InputError, key="[environment] warm_up"):
        calibrate(warm)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"[3, 0, 0]": "[3, 1, 0]"}, "[method] temperature_order"),
        ({"[3, 0, 0]": "[3, 0, 1]"}, "[method] temperature_order"),
        ({'white = "9 °/h/√Hz"\n': ""}, "[sensor.gyro] white"),
        ({'kind = "ramp"': 'kind = "soaks"'}, "[environment] kind"),
        (
            {'kind = "ramp"': 'kind = "ramp"\ngyro_repeatability = "5 °/h"'},
            "[environment] gyro_repeatability",
        ),
        ({'temperature = "temp"\n': ""}, "[data] temperature"),
    ],
    ids=["scale", "misalignment", "no noise", "soaks", "repeatability", "no temperature"],
)
def test_what_a_ramp_cannot_use_is_refused(changes: dict[str, str], key: str, tmp_path: Path):
    simulated(tmp_path, RAMP)
    with refused(InputError, key=key):
        calibrate(written(tmp_path, RAMP, changes))


def test_a_ramp_within_ten_kelvin_is_refused(tmp_path: Path):
    path = simulated(
        tmp_path, RAMP, {'["-10 °C", "60 °C", "-10 °C"]': '["20 °C", "28 °C", "20 °C"]'}
    )
    with refused(InputError, key="[data] temperature"):
        calibrate(path)


def test_a_simulation_without_temperatures_names_the_key(tmp_path: Path):
    path = written(tmp_path, SOAKS, {f"temperatures = {TEMPERATURES}\n": ""})
    with refused(InputError, key="[environment] temperatures"):
        simulate(path)


HELD = (HERE / "hand_held_soaks.toml").read_text(encoding="utf-8")


@pytest.mark.slow
def test_hand_held_soaks_count_what_rows_have_in_common(tmp_path: Path):
    nees: list[float] = []
    path = simulated(tmp_path, HELD, seed=0)
    found = calibrate(path).calibration
    for seed in range(1, 5):
        simulated(tmp_path, HELD, seed=seed)
        found = calibrate(path).calibration
        error = found.values - truth_of(path, found)
        nees.append(float(error @ np.linalg.solve(found.covariance, error)))
    dof = 4 * len(found.sensor.coefficients)
    assert float(chdtri(dof, 0.9995)) < sum(nees) < float(chdtri(dof, 0.0005))
    shared = {'temperature_sd = "0.1 K"\n': "", 'accelerometer_repeatability = "50 µg"\n': ""}
    alone = calibrate(written(tmp_path, HELD, shared)).calibration
    assert 2 * alone.uncertainty("ax.k0_dT") < found.uncertainty("ax.k0_dT")


@pytest.mark.slow
def test_a_turntable_follows_a_ramp_with_its_temperatures(tmp_path: Path):
    examples = HERE.parents[1] / "examples" / "turntable"
    (tmp_path / "path.csv").write_bytes((examples / "path.csv").read_bytes())
    text = (examples / "mimu.toml").read_text(encoding="utf-8")
    truth = '"ax.k0_dT" = "200 µg/K"\n"ay.k1_dT" = "80 ppm/K"\n"gx.bias_dT" = "20 °/h/K"\n'
    more = """temperature_order = [1, 1, 0]
[environment]
kind = "ramp"
temperature_sd = "0.2 K"
lag = "10 s"
temperatures = ["20 °C", "40 °C", "20 °C"]
ramp_rate = "10 K/min"
case_time = "20 s"
"""
    changes = {
        "mimu.csv": "mimu.npz",
        "[bench]\n": truth + "[bench]\n",
        'label = "step"': 'label = "step"\ntemperature = "temp"',
    }
    path = simulated(tmp_path, text + more, changes)
    found = calibrate(path).calibration
    error = found.values - truth_of(path, found)
    nees = error @ np.linalg.solve(found.covariance, error)
    dof = len(error)
    assert float(chdtri(dof, 0.9995)) < nees < float(chdtri(dof, 0.0005))
    exact = written(tmp_path, text + more, changes | {'temperature_sd = "0.2 K"\n': ""})
    assert calibrate(exact).calibration.uncertainty("gx.bias") < 0.9 * found.uncertainty("gx.bias")


def test_a_refusal_over_soaks_names_the_run_file_once(tmp_path: Path):
    path = simulated(tmp_path, HELD)
    text = path.read_text(encoding="utf-8")
    order = next(line for line in text.splitlines() if line.startswith("temperature_order"))
    path.write_text(text.replace(order, 'temperature_order = "auto"'), encoding="utf-8")
    with refused(InputError, key="[method] temperature_order") as refusal:
        calibrate(path)
    assert str(refusal.value).count(str(path)) == 1


def test_the_uncertainty_of_a_lag_is_refused_where_nothing_weighs_it(tmp_path: Path):
    vague = {'temperature_sd = "0.1 K"': 'temperature_sd = "0.1 K"\nlag = "20 s ± 5 s"'}
    lag = read(written(tmp_path / "weighed", SOAKS, vague)).environment.lag  # type: ignore[union-attr]
    assert (lag.value, lag.sd) == (20.0, 5.0)  # type: ignore[union-attr]
    with refused(InputError, key="[environment] lag"):
        read(written(tmp_path / "held", HELD, vague))
    ramp = vague | {
        "[environment]\n": '[environment]\nkind = "ramp"\n',
        'accelerometer_repeatability = "50 µg"\n': "",
    }
    with refused(InputError, key="[environment] lag"):
        read(written(tmp_path / "ramp", SOAKS, ramp))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("order", "late", "grade", "found"),
    [
        ([2, 1, 0], 12.0, "unreliable", {"soak or order"}),
        ([2, 2, 0], 12.0, "reservations", {"temperature_order"}),
        ([1, 1, 0], 0.0, "consistent", set[str]()),
    ],
)
def test_three_soaks_do_not_tell_a_wrong_temperature_from_a_higher_order(
    order: list[int], late: float, grade: str, found: set[str], tmp_path: Path
):
    lines = (EXAMPLES / "six_position/soaks.csv").read_text(encoding="utf-8").splitlines()
    rows = [line.rsplit(",", 1) for line in lines if line[0] in "xyz"]
    warm = [float(t) + late * (abs(float(t) - 20) < 10) for _, t in rows]
    table = [f"{start},{t:.2f}" for (start, _), t in zip(rows, warm, strict=True)]
    text = "\n".join(["position,acc_x,acc_y,acc_z,temp", *table])
    (tmp_path / "soaks.csv").write_text(text, encoding="utf-8")
    path = tmp_path / "run.toml"
    changes = (("method", "also", None), ("method", "temperature_order", order))
    path.write_text(toml(example("six_position/soaks.toml", *changes)), encoding="utf-8")
    outcome = calibrate_run(read(path), advise=False)
    assert outcome.verdict.grade == grade
    asked = {"soak or order", "temperature_order"}
    assert {one.what for one in outcome.findings} & asked == found
    assert not [one for one in outcome.verdict.advice if "k1_dT2" in one.coefficients]
    (hidden,) = [one for one in outcome.verdict.explanation if one.heading == UNDETECTABLE]
    assert any("temperature of one soak" in one for one in hidden.lines) == (order[1] == 2)


@pytest.mark.slow
def test_a_soak_at_another_temperature_than_recorded_is_named(tmp_path: Path):
    path = simulated(tmp_path, SOAKS)
    with np.load(tmp_path / "soaks.npz", allow_pickle=False) as stored:
        columns = dict(stored)
    name = next(key for key in columns if key.startswith("temp"))
    warm = columns[name]
    columns[name] = np.where(np.abs(warm - 25.0) < 10, warm + 5.0, warm)
    np.savez(tmp_path / "soaks.npz", **columns)
    outcome = calibrate(path)
    assert outcome.verdict.grade == "unreliable"
    (found,) = [one for one in outcome.findings if one.what == "soak"]
    assert "the soak at 30.1 °C does not fit" in found.message
    assert "30.1 °C" in outcome.verdict.lines[0]


@pytest.mark.slow
def test_a_thermometer_that_is_stuck_over_several_soaks_is_named(tmp_path: Path):
    path = simulated(tmp_path, SOAKS)
    with np.load(tmp_path / "soaks.npz", allow_pickle=False) as stored:
        columns = dict(stored)
    name = next(key for key in columns if key.startswith("temp"))
    columns[name] = np.minimum(columns[name], 45.0)
    np.savez(tmp_path / "soaks.npz", **columns)
    outcome = calibrate_run(read(path), advise=False)
    assert "thermometer was stuck" in outcome.verdict.lines[1]
    assert not any('"auto"' in line for line in outcome.verdict.lines)


def test_a_ramp_needs_no_bench(tmp_path: Path):
    assert read(written(tmp_path, RAMP, {'[bench]\nkind = "hand"\n': ""})).environment is not None
    soaks = SOAKS[: SOAKS.index("[bench]")] + SOAKS[SOAKS.index("[environment]") :]
    with refused(InputError, key="[bench]"):
        read(written(tmp_path, soaks))


G, AXES = 9.80665, ("x", "y", "z")
KNOWN = {f"a{axis}.k0_dT": "50 µg/K ± 5 µg/K" for axis in AXES}


def means_at_one_temperature(seed: int, error_k: float) -> dict[str, list[object]]:
    """Return means at six faces by 23 °C, whose thermometer has an error common to all rows."""
    rng = np.random.default_rng(seed)
    drift = (50e-6 + 5e-6 * rng.normal(size=3)) * (3.0 + error_k * rng.normal())  # g, from 20 °C
    table: dict[str, list[object]] = {key: [] for key in ("position", *AXES, "t")}
    for axis in range(3):
        for sign, word in ((1.0, "p"), (-1.0, "a")):
            force = sign * np.eye(3)[axis] + drift + 20e-6 * rng.normal(size=3)
            table["position"].append(f"{AXES[axis]}_{word}")
            table["t"].append(23.0 + 0.05 * rng.normal())
            for name, reading in zip(AXES, force.tolist(), strict=True):
                table[name].append(reading)
    return table


def calibrated_at_one_temperature(
    table: dict[str, list[object]], prior: Mapping[str, str] = KNOWN
) -> Outcome:
    return calibrate(
        table,
        method={"name": "six_position", "also": ["k0_dT"], "prior": prior},
        sensor={"name": "triad", "accelerometer": {"unit": "g"}},
        bench={"gravity": f"{G} m/s² ± 5 ppm", "tilt": "0.01 °"},
        environment={"kind": "soaks", "temperature_sd": "0.5 K"},
        kind="means", label="position", accelerometer=list(AXES), temperature="t",
        temperature_unit="°C", sd={"accelerometer": "20 µg"},
    )  # fmt: skip


def test_the_error_of_the_thermometer_is_in_u_if_the_temperature_coefficients_are_known():
    ratios: list[float] = []
    for seed in range(60):
        outcome = calibrated_at_one_temperature(means_at_one_temperature(seed, 0.5))
        # Only warnings could be wrong: no soak needs to test the others.
        assert not [one for one in outcome.findings if one.severity != "note"]
        found = outcome.calibration
        ratios.append(found.value("ax.k0") / found.uncertainty("ax.k0"))
        # 20 µg / √2 (the tilt hides x in other rows), 5 µg/K for 3 K, and 50 µg/K for 0.5 K
        u = np.sqrt(20**2 / 2 + (5 * 3) ** 2 + (50 * 0.5) ** 2) * 1e-6 * G
        assert found.uncertainty("ax.k0") == pytest.approx(u, rel=0.02)
    # √(χ²/60) is within 0.76 to 1.24 in 99 % of cases.
    assert 0.76 < np.sqrt(np.mean(np.square(ratios))) < 1.24


def test_a_temperature_coefficient_without_a_prior_needs_a_range_of_temperatures():
    some = {name: text for name, text in KNOWN.items() if name != "az.k0_dT"}
    with refused(key="[data] temperature"):
        calibrated_at_one_temperature(means_at_one_temperature(0, 0.5), some)

"""White noise behind a sensor's own low-pass filter, and limits in place of zeros."""

# SciPy's stubs are partial.
# pyright: reportArgumentType=false, reportOptionalIterable=false, reportAssignmentType=false
# pyright: reportGeneralTypeIssues=false

import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, freqz, lfilter
from tests.base_seeds import evidence
from tests.noise.filtered_generator import DEG_H, DEG_SQRT_H, FilteredTruth, readings
from tests.noise.generator import MEMS, draw
from tests.program import run_program

import inercal
from inercal.basics.errors import InputError
from inercal.noise.channel_noise import ChannelNoise, NoiseAnalysis
from inercal.noise.disturbances import find_disturbances
from inercal.noise.noise_files import kalibr_text
from inercal.noise.output_filter import SHAPES, OutputFilter, filtered_avar
from inercal.noise.sensor_noise import sensor_noise
from inercal.noise.stream_analysis import analyse_noise_stream
from inercal.recordings import Recording

DEG = np.pi / 180
LOW_PASS = ("--set", "sensor.gyro.unit=LSB", "--set", "sensor.gyro.scale=100000 LSB/(°/s)",
            "--set", "data.rate=100 Hz")  # fmt: skip
REST = ("--set", "sensor.gyro.unit=rad/s", "--set", "sensor.accelerometer.unit=m/s²")
SHAPE = {one.name: one for one in SHAPES}


def recording(truth: FilteredTruth, seed: int) -> Recording:
    y = readings(truth, seed)
    return Recording(truth.dt * np.arange(y.size), y[:, None], ("gx",), ("°/s",))


def analyse(truth: FilteredTruth, seed: int = 1, **options: str) -> ChannelNoise:
    return inercal.analyse_noise(recording(truth, seed), kinds=(), **options).channels[0]  # type: ignore[arg-type]


def numbers(text: str) -> list[float]:
    """Return the numbers that stand behind a colon in YAML, without zeros of a covariance."""
    return [float(one) for one in re.findall(r"^\s*\w+: ([-+.\de]+)", text, re.MULTILINE)]


@pytest.mark.parametrize(
    ("name", "b", "a", "cutoff"),
    [
        ("one pole", [1 - np.exp(-2 * np.pi * 0.1)], [1, -np.exp(-2 * np.pi * 0.1)], 0.1),
        ("one pole, digital", *butter(1, 0.4), 0.2),
        ("Butterworth, digital", *butter(2, 0.4), 0.2),
        ("average of 2", [0.5, 0.5], [1], np.nan),
        ("average of 4", [0.25] * 4, [1], np.nan),
        ("two averages of 2", [0.25, 0.5, 0.25], [1], np.nan),
    ],
)
def test_shapes_pass_what_their_filters_pass(name: str, b: object, a: object, cutoff: float):
    w = np.linspace(0.01, 3.1, 50)
    _, response = freqz(b, a, w)
    assert np.allclose(SHAPE[name].power(w, cutoff), np.abs(response) ** 2, atol=1e-12)


def test_an_analog_butterworth_folds_back_and_passes_everything_at_zero():
    found = SHAPE["Butterworth, analog"].power(np.array([0.0, np.pi]), 0.2)
    assert found[0] == pytest.approx(1)
    assert found[1] == pytest.approx(2 / (1 + 2.5**4), rel=0.02)


def test_the_allan_variance_behind_a_pole_is_that_of_simulated_readings():
    truth = FilteredTruth("pole", 5, seconds=4000)
    y = readings(truth, 3) / (truth.white * DEG_SQRT_H)
    output = OutputFilter(SHAPE["one pole"], 5.0, 0.05, truth.dt)
    x = np.concatenate([[0.0], np.cumsum(y)])
    for m in (1, 4, 16, 64):
        d = x[2 * m :] - 2 * x[m:-m] + x[: -2 * m]
        (expected,) = filtered_avar("N", np.array([m * truth.dt]), truth.dt, 1.0, output)
        assert np.mean(d**2) / (2 * m**2) == pytest.approx(expected, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "cutoff", "rate", "shape"),
    [
        ("pole", 5, 100, "one pole"),
        evidence("pole", 42, 100, "one pole"),
        ("pole, digital", 20, 100, "one pole, digital"),
        evidence("average", 2, 100, "average of 2"),
        ("average", 4, 100, "average of 4"),
        ("Butterworth", 20, 200, "Butterworth, digital"),
    ],
)
def test_a_filter_is_found_with_its_cutoff_and_n_is_its_plateau(
    kind: str, cutoff: float, rate: float, shape: str
):
    truth = FilteredTruth(kind, cutoff, rate, seconds=300)
    found = analyse(truth, 2)
    assert found.output is not None
    assert found.output.shape.name == shape
    if kind != "average":
        assert abs(found.output.cutoff - cutoff) < 3 * found.output.u
        assert found.output.u >= 0.0099 * found.output.cutoff
    white, flicker = found.coefficient("N"), found.coefficient("B")
    assert white is not None
    assert flicker is not None
    assert abs(white.value / DEG - truth.sampled_white) < 3 * white.u / DEG
    assert white.u < 0.03 * white.value
    assert flicker.is_limit
    assert found.goodness.fits or found.goodness.worst_band is None or (
        found.goodness.worst_band[1] < 0.1 * cutoff
    )  # fmt: skip


@pytest.mark.slow
def test_flicker_and_rounding_behind_a_filter_are_found_beside_it():
    truth = FilteredTruth("pole", 20, seconds=1200, flicker=20.0, step=0.0076)
    found = analyse(truth, 4)
    assert found.output is not None
    assert found.output.shape.name == "one pole"
    white, flicker = found.coefficient("N"), found.coefficient("B")
    assert white is not None
    assert flicker is not None
    assert abs(white.value / DEG - truth.sampled_white) < 3 * white.u / DEG
    assert abs(flicker.value / DEG - 20 * DEG_H) < 3 * flicker.u / DEG


@pytest.mark.parametrize(
    "truth",
    [
        FilteredTruth(seconds=200),
        FilteredTruth(seconds=200, flicker=20.0, walk=2.0),
        FilteredTruth(seconds=200, increments=3e-4),
        FilteredTruth(seconds=200, step=0.02),
    ],
)
def test_a_sensor_without_a_filter_has_none(truth: FilteredTruth):
    found = analyse(truth, 100)
    assert found.output is None
    assert found.refusal is None
    assert found.band == np.inf


@pytest.mark.slow
def test_q_n_and_b_are_fitted_together():
    truth = FilteredTruth(seconds=1200, flicker=60.0, increments=1e-4)
    found = analyse(truth, 7)
    assert set("QNB") <= set(found.fit.symbols)
    white = found.coefficient("N")
    assert white is not None
    assert abs(white.value / DEG - 0.3 * DEG_SQRT_H) < 3 * white.u / DEG


@pytest.mark.slow
def test_an_unknown_filter_leaves_a_band_from_which_n_comes():
    truth = FilteredTruth("Chebyshev", 20, seconds=600)
    found = analyse(truth, 2)
    white = found.coefficient("N")
    assert found.output is None
    assert found.band < 20
    assert white is not None
    assert abs(white.value / DEG - truth.sampled_white) < 3 * white.u / DEG
    assert white.u > 0.01 * white.value
    assert not found.goodness.fits


@pytest.mark.slow
@pytest.mark.parametrize("cutoff", [0.03, 0.1])
def test_a_filter_near_the_flicker_is_refused_by_name(cutoff: float):
    truth = FilteredTruth("pole", cutoff, seconds=900, flicker=10.0)
    analysis = inercal.analyse_noise(recording(truth, 1), kinds=())
    refusal = analysis.channels[0].refusal
    assert refusal is not None
    assert {"N", "B"} <= set(refusal.symbols)
    assert not analysis.channels[0].coefficients
    with pytest.raises(InputError, match="gx: N, B and K"):
        sensor_noise(analysis)


@pytest.mark.slow
def test_nothing_is_written_of_a_refused_channel(tmp_path: Path):
    truth = FilteredTruth("pole", 0.1, 20, seconds=900, flicker=10.0)
    y = readings(truth, 1)
    log, target = tmp_path / "log.csv", tmp_path / "run.toml"
    table = np.column_stack([truth.dt * np.arange(y.size), y, -y, y[::-1]])
    np.savetxt(log, table, "%.9g", ",", header="time,gx,gy,gz", comments="")
    options = ("--set", "sensor.gyro.unit=°/s", "--out", tmp_path)
    register = ("--register", tmp_path / "r.db", "--sensor", "imu")
    for extra in (("--write", target, "--to", "kalibr"), register):
        done = run_program("noise", log, *options, *extra)
        assert done.status == 2
        assert len(done.error.splitlines()) == 1
        assert "N, B" in done.error
    assert sorted(one.name for one in tmp_path.iterdir() if one.suffix != ".db") == ["log.csv"]
    shown = run_program("noise", log, *options, "--json")
    assert shown.status == 0
    refused = json.loads(shown.output)["channels"][0]["refused"]
    assert refused["symbols"] == ["N", "B", "K"]


@pytest.mark.slow
def test_a_slow_gauss_markov_process_is_no_filter_and_is_not_refused():
    y = draw(MEMS.without(n=32768, flicker=0.0, walk=0.0, markov=8.0, markov_time=300.0), 5)[0]
    one = Recording(0.25 * np.arange(y.size), y[:, None], ("gx",), ("rad/s",))
    (found,) = inercal.analyse_noise(one, kinds=()).channels
    assert found.output is None
    assert found.refusal is None
    assert "G" in found.fit.symbols


@pytest.mark.slow
def test_white_noise_that_is_seen_beside_a_strong_walk_is_not_refused():
    # They are equal at 0.8 Hz: above it a recording at 100 Hz shows the white noise.
    rng, n, dt = np.random.default_rng(3), 60_000, 0.01
    white = 0.01 / np.sqrt(dt) * rng.standard_normal(n)
    walk = 0.05 * np.sqrt(dt) * np.cumsum(rng.standard_normal(n))
    made = Recording(dt * np.arange(n), (white + walk)[:, None], ("gx",), ("rad/s",))
    found = inercal.analyse_noise(made, kinds=()).channels[0]
    assert found.refusal is None
    white_found, walk_found = found.coefficient("N"), found.coefficient("K")
    assert white_found is not None
    assert walk_found is not None
    assert white_found.value == pytest.approx(0.01, rel=0.02)
    assert walk_found.value == pytest.approx(0.05, rel=0.05)


@pytest.mark.slow
def test_a_time_constant_at_the_edge_of_its_grid_has_no_uncertainty():
    y = draw(MEMS.without(n=8192, flicker=0.0, walk=3.0), 2)[0]
    one = Recording(0.25 * np.arange(y.size), y[:, None], ("gx",), ("rad/s",))
    (found,) = inercal.analyse_noise(one, kinds=(), terms="NG").channels
    time = found.coefficient("T")
    assert time is not None
    assert time.value > 0.8 * found.bins.times[-1]
    assert (time.u, time.high) == (np.inf, np.inf)
    (chosen,) = inercal.analyse_noise(one, kinds=()).channels
    assert "G" not in chosen.fit.symbols


@pytest.mark.slow
def test_what_is_not_significant_has_an_interval_with_zero():
    absent = 0
    for seed in range(3):
        y = draw(MEMS.without(n=2048), seed)[0]
        one = Recording(0.25 * np.arange(y.size), y[:, None], ("gx",), ("rad/s",))
        (found,) = inercal.analyse_noise(one, kinds=()).channels
        for coefficient in found.coefficients:
            if coefficient.is_significant is False:
                absent += 1
                assert (coefficient.value, coefficient.low) == (0, 0)
                assert 0 < coefficient.high < np.inf
        walk = found.coefficient("K")
        assert walk is not None
    assert absent > 1


@pytest.mark.slow
def test_the_report_behind_20_hz_gives_the_plateau_no_flicker_and_a_page_with_its_filter(
    reports_dir: Path, tmp_path: Path
):
    log, target = reports_dir / "04_lowpass_20Hz.csv", tmp_path / "run.toml"
    done = run_program("noise", log, *LOW_PASS, "--json", "--write", target, "--report",
                       "--out", tmp_path)  # fmt: skip
    assert done.status == 0, done.error
    page = (tmp_path / "04_lowpass_20Hz.noise.html").read_text(encoding="utf-8")
    assert 'id="filter"' in page
    for channel in json.loads(done.output)["channels"]:
        found = {one["symbol"]: one for one in channel["coefficients"]}
        assert abs(found["N"]["value_in_unit"] - 0.3) < 2 * found["N"]["u"] / (
            found["N"]["value"] / found["N"]["value_in_unit"]
        )
        assert found["B"]["significant"] is False
        size = np.pi / 180 / 3600  # of °/h/√s
        assert found["K"]["low"] / size < 1 < found["K"]["high"] / size
        assert channel["filter"]["poles"] == 1
        assert abs(channel["filter"]["cutoff"] - 20) < 2 * channel["filter"]["u"]
    gyro = tomllib.loads(target.read_text(encoding="utf-8"))["sensor"]["gyro"]
    assert "bias_instability" not in gyro
    assert float(gyro["white"].split()[0]) == pytest.approx(0.3, rel=0.02)
    assert float(gyro["random_walk"].split()[0]) > 0


@pytest.mark.slow
def test_the_report_of_white_noise_gives_files_without_a_zero_that_exports_take(
    reports_dir: Path, tmp_path: Path
):
    log, target = reports_dir / "13_rest_white_only.csv", tmp_path / "run.toml"
    to = ("--to", "kalibr", "--to", "ros", "--to", "filter")
    done = run_program("noise", log, *REST, *to, "--write", target, "--out", tmp_path, "--json")
    assert done.status == 0, done.error
    for name in ("kalibr", "ros", "filter"):
        text = (tmp_path / f"13_rest_white_only.{name}.yaml").read_text(encoding="utf-8")
        assert all(one > 0 for one in numbers(text))
    kalibr = (tmp_path / "13_rest_white_only.kalibr.yaml").read_text(encoding="utf-8")
    limits = [
        one["high"]
        for channel in json.loads(done.output)["channels"]
        for one in channel["coefficients"]
        if one["symbol"] == "K" and channel["quantity"] == "gyro"
    ]
    written = float(re.findall(r"gyroscope_random_walk: (\S+)", kalibr)[0])
    assert written == pytest.approx(np.sqrt(np.mean(np.square(limits))), rel=1e-4)
    sensor = tomllib.loads(target.read_text(encoding="utf-8"))["sensor"]
    for kind in ("gyro", "accelerometer"):
        assert float(sensor[kind]["random_walk"].split()[0]) > 0
        assert "bias_instability" not in sensor[kind]


def test_a_data_sheet_without_drift_writes_no_zero(tmp_path: Path):
    sheet = tmp_path / "sheet.toml"
    sheet.write_text(
        '[datasheet]\nname = "IMU"\nrate = "200 Hz"\n[datasheet.gyro]\nwhite = "0.15 °/√h"\n'
        'white_kind = "random walk"\n',
        encoding="utf-8",
    )
    done = run_program("noise", "--datasheet", sheet, "--to", "kalibr", "--out", tmp_path)
    assert done.status == 2
    assert "random_walk" in done.error
    assert not list(tmp_path.glob("*.yaml"))
    done = run_program(
        "noise", "--datasheet", sheet, "--to", "ros", "--to", "filter", "--out", tmp_path
    )
    assert done.status == 0, done.error
    for path in tmp_path.glob("*.yaml"):
        assert all(one > 0 for one in numbers(path.read_text(encoding="utf-8")))


@pytest.mark.slow
def test_an_axis_without_a_random_walk_counts_with_its_limit():
    quiet = draw(MEMS.without(n=8192, flicker=0.0, walk=0.0), 1)[0]
    walking = draw(MEMS.without(n=8192, flicker=0.0, walk=2.0), 2)[0]
    one = Recording(0.25 * np.arange(8192.0), np.stack([quiet, walking], 1), ("gx", "gy"),
                    ("rad/s",) * 2)  # fmt: skip
    analysis: NoiseAnalysis = inercal.analyse_noise(one, kinds=())
    x, y = (channel.value_or_limit("K") for channel in analysis.channels)
    assert analysis.channels[0].value("K") == 0
    triad = sensor_noise(analysis).triads["gyro"]
    assert triad.values["K"][0] == pytest.approx(np.hypot(x, y) / np.sqrt(2))
    assert "gx" in " ".join(triad.notes)
    walk = re.findall(r"random_walk: (\S+)", kalibr_text(sensor_noise(analysis)))
    assert float(walk[0]) == pytest.approx(triad.values["K"][0], rel=1e-5)


@pytest.mark.slow
def test_what_another_analysis_wrote_is_replaced_and_the_filter_is_printed(
    reports_dir: Path, tmp_path: Path
):
    target = tmp_path / "run.toml"
    target.write_text(
        '[sensor.gyro]\nunit = "LSB"\nbias_instability = "113 °/h"\n'
        "# inercal noise: gx: behind an old filter\n",
        encoding="utf-8",
    )
    done = run_program("noise", reports_dir / "04_lowpass_20Hz.csv", *LOW_PASS, "--write", target,
                       "--force")  # fmt: skip
    assert done.status == 0, done.error
    assert done.output.count("low-pass filter") == 3
    text = target.read_text(encoding="utf-8")
    assert "113" not in text
    assert "old filter" not in text
    assert 'unit = "LSB"' in text


@pytest.mark.slow
def test_a_recording_in_blocks_has_the_filter_of_one_in_the_memory():
    truth = FilteredTruth("pole", 20, seconds=1500, step=0.002)
    y = readings(truth, 5)[:, None]
    whole = analyse(truth, 5)
    blocks = analyse_noise_stream(
        (y[k : k + 40_000] for k in range(0, len(y), 40_000)), truth.dt, ("gx",), ("°/s",)
    ).channels[0]
    assert whole.output is not None
    assert blocks.output is not None
    assert blocks.output.shape is whole.output.shape
    assert blocks.output.cutoff == pytest.approx(whole.output.cutoff, rel=0.02)
    assert blocks.value("N") == pytest.approx(whole.value("N"), rel=0.02)


def test_noise_behind_a_filter_raises_no_bursts():
    rng = np.random.default_rng(3)
    b, a = butter(2, 0.1)
    for _ in range(6):
        y = lfilter(b, a, rng.standard_normal(100_000))[2000:]
        assert not [one for one in find_disturbances(y, 0.01) if one.kind == "burst"]


@pytest.mark.slow
def test_coarse_steps_hide_no_noise_that_a_filter_made_slow():
    # The differences of neighbours are a sixth of a step, the noise itself is of 1.2 steps.
    y = readings(FilteredTruth("pole", 1, seconds=300), 3)
    step = y.std() / 1.2
    one = Recording(0.01 * np.arange(y.size), np.round(y / step)[:, None] * step, ("gx",), ("°/s",))
    inercal.analyse_noise(one, kinds=())


@pytest.mark.parametrize(
    ("name", "size"),
    [pytest.param("gyro", 1 / 4770, marks=pytest.mark.slow), evidence("acc", 1 / 415)],
)
def test_a_public_imu_at_rest_has_one_filter_on_all_axes(data_dir: Path, name: str, size: float):
    table = np.loadtxt(data_dir / "xsens_mti_multiposition" / f"xsens_{name}.mat")
    rest = table[table[:, 0] < 45.0]
    unit = "rad/s" if name == "gyro" else "m/s²"
    one = Recording(rest[:, 0] - rest[0, 0], rest[:, 1:] * size, ("x", "y", "z"), (unit,) * 3)
    # The counts of the accelerometers have an offset.
    found = inercal.analyse_noise(one, kinds=(), gravity=None).channels
    assert all(channel.output is not None for channel in found)
    cutoffs = [channel.output.cutoff for channel in found if channel.output is not None]
    assert max(cutoffs) < 1.5 * min(cutoffs)
    whites = [channel.value("N") for channel in found]
    assert max(whites) < 1.3 * min(whites)

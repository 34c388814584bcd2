"""The noise in use: written into a run file, as the states of a filter, and in a plan."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from tests.noise.generator import MEMS, Truth, draw
from tests.program import run_program

from inercal.methods.turntable.model import triad_model
from inercal.noise import NoiseAnalysis, analyse_noise
from inercal.noise.filter_file import filter_text, flicker_states
from inercal.noise.sensor_noise import sensor_noise
from inercal.recordings import Recording
from inercal.runfile import read

EXAMPLES = Path(__file__).parents[2] / "examples"
MICRO_G = 9.80665e-6


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a log of an IMU at rest: gyros with N, B and K, accelerometers with N and B."""
    n, dt = 32768, 0.25
    rate = np.degrees(draw(replace(MEMS, n=n), 5, 3).T)
    force = draw(Truth(n, dt, 100.0, 60.0, unit=MICRO_G), 6, 3).T + np.array([0, 0, 9.80665])
    path = tmp_path_factory.mktemp("imu") / "rest.csv"
    table = np.column_stack([dt * np.arange(n), force, rate])
    head = "time,ax,ay,az,gx,gy,gz"
    np.savetxt(path, table, "%.12g", ",", header=head, comments="")
    return path


@pytest.mark.slow
def test_the_section_that_is_written_is_the_noise_of_the_run_and_changes_q(
    log: Path, tmp_path: Path
):
    folder = tmp_path / "turntable"
    shutil.copytree(EXAMPLES / "turntable", folder)
    target = folder / "mimu.toml"
    before = read(target).sensor
    options = ("--set", "sensor.gyro.unit=°/s", "--terms", "NBK", "--write", target, "--force")
    done = run_program("noise", log, *options, "--json")
    assert done.status == 0, done.error
    after = read(target).sensor
    channels = json.loads(done.output)["channels"]
    for kind, measures in (("gyro", "w"), ("accelerometer", "f")):
        own = [one for one in channels if one["quantity"] == kind]
        noise = next(axis.noise for axis in after.axes if axis.measures == measures)
        found = (noise.white, noise.bias_instability, noise.random_walk)
        for symbol, value in zip("NBK", found, strict=True):
            values = [
                c["value"] or c["high"]  # the upper limit of an axis without the term
                for one in own
                for c in one["coefficients"]
                if c["symbol"] == symbol
            ]
            # The file has two digits of u.
            assert value == pytest.approx(np.sqrt(np.mean(np.square(values))), rel=0.02)
    old, new = (triad_model(one, "w") for one in (before, after))
    gyro = next(axis.noise for axis in after.axes if axis.measures == "w")
    assert new.white == pytest.approx(gyro.white**2)
    assert new.drift.walk == pytest.approx(gyro.random_walk**2)
    assert not old.drift.walk.any()
    flicker = next(axis.noise for axis in before.axes if axis.measures == "w").bias_instability
    ratio = (gyro.bias_instability / flicker) ** 2
    decaying = np.isfinite(new.drift.times)
    assert new.drift.variance[decaying] == pytest.approx(ratio * old.drift.variance)


@pytest.mark.slow
def test_a_plan_expects_more_uncertainty_of_more_noise(log: Path, tmp_path: Path):
    quiet, target = tmp_path / "quiet.toml", tmp_path / "run.toml"
    text = (
        '[sensor]\nname = "imu"\n[sensor.accelerometer]\nunit = "m/s²"\nwhite = "1 µg/√Hz"\n'
        '[sensor.gyro]\nunit = "°/s"\nwhite = "0.001 °/√h"\n'
        '[bench]\ngravity = "9.81 m/s² ± 1 µm/s²"\nlatitude = "38 °"\n'
        '[data]\nfile = "log.csv"\nrate = "100 Hz"\naccelerometer = ["ax", "ay", "az"]\n'
        'gyro = ["gx", "gy", "gz"]\n[method]\nname = "multi_position"\n'
    )
    for path in (quiet, target):
        path.write_text(text)
    done = run_program("noise", log, "--set", "sensor.gyro.unit=°/s", "--write", target, "--force")
    assert done.status == 0, done.error
    found = []
    for path in (quiet, target):
        planned = run_program("plan", path, "--json", "--positions", "12", "--seconds", "1")
        assert planned.status == 0, planned.error
        found.append(json.loads(planned.output))
    stds = [{one["name"]: one["std"] for one in content["expected"]} for content in found]
    assert stds[1]["gx.bias"] > 3 * stds[0]["gx.bias"]
    assert stds[1]["ax.k0"] > 3 * stds[0]["ax.k0"]


@pytest.mark.parametrize(
    ("decades", "states", "largest"), [(2, 3, 0.013), (3, 4, 0.017), (4, 4, 0.044), (4, 5, 0.015)]
)
def test_a_chain_is_flicker_within_the_misfit_of_the_note(
    decades: int, states: int, largest: float
):
    chain = flicker_states(1.0, 10.0**decades, states)
    assert chain.misfit < largest
    tau = np.geomspace(1, 10.0**decades, 977)
    x = tau[:, None] / chain.times
    terms = (2 * x - 3 + 4 * np.exp(-x) - np.exp(-2 * x)) / x**2
    deviation = np.sqrt(terms @ chain.variances / (2 * np.log(2) / np.pi))
    assert np.abs(deviation - 1).max() == pytest.approx(chain.misfit, rel=0.05)


def analysis(terms: str = "NBK") -> NoiseAnalysis:
    y = draw(replace(MEMS, n=16384), 3, 3)
    recording = Recording(MEMS.dt * np.arange(16384.0), y.T, ("gx", "gy", "gz"), ("rad/s",) * 3)
    return analyse_noise(recording, terms=terms, kinds=())


@pytest.mark.slow
def test_the_states_of_the_filter_make_the_allan_deviation_of_the_fit():
    yaml = pytest.importorskip("yaml")
    found = analysis()
    gyro = yaml.safe_load(filter_text(sensor_noise(found), 100.0))["gyro"]
    dt, n = gyro["step"], 1 << 20
    white, flicker, walk = (
        np.sqrt(np.mean([one.value(s) ** 2 for one in found.channels])) for s in "NBK"
    )
    rng = np.random.default_rng(4)
    y = np.sqrt(gyro["white_variance"]) / dt * rng.standard_normal(n)
    y += np.cumsum(np.sqrt(gyro["walk_variance"]) * rng.standard_normal(n))
    for state in gyro["states"]:
        assert state["q"] == pytest.approx(
            state["variance"] * (1 - np.exp(-2 * dt / state["time"])), rel=1e-4
        )
        shocks = np.sqrt(state["q"]) * rng.standard_normal(n)
        shocks[0] = np.sqrt(state["variance"]) * rng.standard_normal()
        y += lfilter([1.0], [1.0, -state["phi"]], shocks)
    x = np.concatenate([[0.0], np.cumsum(y)])
    for m in (8, 64, 512):
        d = x[2 * m :] - 2 * x[m:-m] + x[: -2 * m]
        tau = m * dt
        expected = white**2 / tau + 0.4413 * flicker**2 + walk**2 * tau / 3
        assert np.mean(d**2) / (2 * m**2) == pytest.approx(expected, rel=0.06)

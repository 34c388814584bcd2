"""Gyros read at the six rests: their biases and their sensitivity to gravity."""

from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.basics.units import Measured
from inercal.benches import Hand
from inercal.calibration import Calibration
from inercal.methods import METHODS
from inercal.physics.plan import Hold, six_positions
from inercal.physics.sensors import imu
from inercal.pipeline import Outcome, calibrate, simulate
from inercal.pipeline.run_simulation import apply_data_columns
from inercal.recordings import Observations
from inercal.recordings.io.write import write_recording
from inercal.runfile import Run, read

EARTH = 7.292115e-5  # rad/s

GYRO = """[sensor.gyro]
unit = "°/s"
white = "0.01 °/s/√Hz"
"""
OF_GYROS = """"gx.bias" = "0.3 °/s"
"gy.bias" = "-0.2 °/s"
"gz.g_o" = "200 °/h/g"
"""
RUN = f"""
[sensor]
name = "imu"
[sensor.accelerometer]
unit = "m/s²"
white = "100 µg/√Hz"
{GYRO}
[sensor.truth]
{OF_GYROS}"ax.k0" = "10 mg"
[bench]
latitude = "48 ° ± 0.01 °"
tilt = "0.2 °"
[data]
file = "six.npz"
time = "time"
rate = "20 Hz"
label = "label"
marks = "labels"
[method]
name = "six_position"
seconds = "20 s"
"""


def prepare(folder: Path, more: str = "") -> Run:
    path = folder / "run.toml"
    path.write_text(RUN + more, encoding="utf-8")
    return read(path)


def recorded(run: Run, seed: int, turning: float = 0.0) -> Outcome:
    """Return the result of a simulated session; gx turns by rad/s while z points up."""
    recording = apply_data_columns(run, simulate(run, seed))
    assert recording.labels is not None
    column = recording.channels.index(run.data.gyro[0])
    recording.data[..., recording.labels == "z_p", column] += np.degrees(turning)
    write_recording(recording, run.file(run.data.file))
    return calibrate(run)


def gyro_errors(run: Run, found: Calibration) -> np.ndarray:
    names = [name for name in found.sensor.coefficients if name.startswith("g")]
    return np.array(
        [(found.value(n) - run.truth.get(n, 0.0)) / found.uncertainty(n) for n in names]
    )


@pytest.mark.parametrize("estimator", ["ml", "classical"])
def test_biases_and_sensitivities_to_gravity_are_found(tmp_path: Path, estimator: str):
    run = prepare(tmp_path, f'estimator = "{estimator}"\n')
    outcome = recorded(run, 3)
    found = outcome.calibration
    gyros = [name for name in found.sensor.coefficients if name.startswith("g")]
    assert {name.partition(".")[2] for name in gyros} == {"bias", "g_i", "g_p", "g_o"}
    limit = 4 if estimator == "ml" else 12  # closed formulas leave the earth's rate out
    assert np.abs(gyro_errors(run, found)).max() < limit
    # White noise of six means, and the earth's rate, whose level part has an unknown azimuth.
    noise = np.deg2rad(0.01) / np.sqrt(120)
    most = {"ml": 3.0, "classical": 1.2}[estimator]
    assert 0.8 * noise < found.uncertainty("gx.bias") < most * noise
    assert outcome.verdict.grade == "consistent"


def test_without_a_section_the_gyros_are_left_out_and_the_verdict_says_so(tmp_path: Path):
    run = prepare(tmp_path)
    recorded(run, 5)
    path = tmp_path / "alone.toml"
    text = RUN.replace(GYRO, "").replace(OF_GYROS, "")
    text = text.replace('time = "time"', 'time = "time"\ngyro = ["gyr_x", "gyr_y", "gyr_z"]')
    path.write_text(text, encoding="utf-8")
    alone = calibrate(path)
    assert not [name for name in alone.calibration.sensor.coefficients if name.startswith("g")]
    assert any("[sensor.gyro]" in line for line in alone.calibration.notes)


def test_gyros_move_the_accelerometers_by_little(tmp_path: Path):
    """Their noise is found from the rests, with correlations between the channels."""
    run = prepare(tmp_path)
    whole = recorded(run, 5).calibration
    path = tmp_path / "alone.toml"
    path.write_text(RUN.replace(GYRO, "").replace(OF_GYROS, ""), encoding="utf-8")
    alone = calibrate(path).calibration
    for name in alone.sensor.coefficients:
        assert abs(whole.value(name) - alone.value(name)) < 0.3 * alone.uncertainty(name)
        assert whole.uncertainty(name) == pytest.approx(alone.uncertainty(name), rel=0.02)


def test_a_rest_that_turns_is_named(tmp_path: Path):
    run = prepare(tmp_path)
    outcome = recorded(run, 4, turning=np.radians(0.05))
    assert outcome.verdict.grade == "unreliable"
    assert outcome.verdict.suspect is not None
    assert outcome.verdict.suspect.name == "z_p"


def test_a_sensitivity_to_gravity_that_is_left_out_is_named(tmp_path: Path):
    run = prepare(tmp_path, 'coefficients = ["bias", "scale", "misalignment"]\n')
    outcome = recorded(run, 4)
    assert outcome.verdict.grade == "unreliable"
    assert outcome.verdict.suspect is not None
    assert outcome.verdict.suspect.name == "gz.g_o"


def test_temperature_names_what_rests_show_of_gyros(tmp_path: Path):
    run = prepare(tmp_path, 'also = ["temperature"]\n')
    warm = {n for n in run.sensor.coefficients if n.startswith("g") and "_dT" in n}
    assert warm == {"gx.bias_dT", "gy.bias_dT", "gz.bias_dT"}
    with refused(names=["gx.scale_dT", "gy.scale_dT", "gz.scale_dT"]):
        prepare(tmp_path, 'also = ["scale_dT"]\n')


def test_means_hold_gyros_too(tmp_path: Path):
    ups = {"x_p": (1, 0, 0), "x_a": (-1, 0, 0), "y_p": (0, 1, 0), "y_a": (0, -1, 0),
           "z_p": (0, 0, 1), "z_a": (0, 0, -1)}  # fmt: skip
    bias = (0.5, -0.25, 0.125)
    lines = ["position,ax,ay,az,gx,gy,gz"]
    lines += [f"{name},{','.join(map(str, (*up, *bias)))}" for name, up in ups.items()]
    (tmp_path / "means.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    path = tmp_path / "run.toml"
    path.write_text(
        '[sensor.accelerometer]\nunit = "g"\n[sensor.gyro]\nunit = "°/s"\n'
        '[bench]\nlatitude = "48 °"\n[data]\nfile = "means.csv"\nkind = "means"\n'
        'label = "position"\naccelerometer = ["ax", "ay", "az"]\ngyro = ["gx", "gy", "gz"]\n'
        'sd = {accelerometer = "1 mg", gyro = "36 °/h"}\n[method]\nname = "six_position"\n',
        encoding="utf-8",
    )
    found = calibrate(path).calibration
    assert np.degrees([found.value(f"g{a}.bias") for a in "xyz"]) == pytest.approx(bias, abs=1e-5)
    # Six means of 36 °/h; the level part of the earth's rate, 10 °/h, enters four of them.
    assert np.degrees(found.uncertainty("gx.bias")) * 3600 == pytest.approx(14.8, abs=0.2)


# Ratio of the root-mean-square error of the biases to what is stated, by the azimuths.
AZIMUTHS = {"independent": (0.9, 1.1), "kept": (1.0, 1.45)}


@pytest.mark.parametrize("azimuths", AZIMUTHS)
def test_the_level_earth_rate_is_in_the_uncertainty(azimuths: str):
    """Kept azimuths are the worst case: each axis then reads one rate in its four level rests."""
    rng, n, sd = np.random.default_rng(11), 400, np.radians(5 / 3600)
    steps = six_positions()
    up = np.array([step.up for step in steps])
    up_rate, level = EARTH * np.sin(np.radians(48)), EARTH * np.cos(np.radians(48))
    heading = rng.uniform(0, 2 * np.pi, (n, 6 if azimuths == "independent" else 1))
    first = np.roll(up, 1, axis=1) if azimuths == "independent" else np.ones((6, 3))
    second = np.roll(up, 2, axis=1) if azimuths == "independent" else np.ones((6, 3))
    along = level * np.cos(heading)[..., None] * first
    across = level * np.sin(heading)[..., None] * second * (azimuths == "independent")
    rate = up_rate * up + (along + across) * (up == 0) + sd * rng.standard_normal((n, 6, 3))
    force = np.broadcast_to(9.81 * up, rate.shape)
    made = np.concatenate([force, rate], axis=-1)
    sensor = METHODS["six_position"].prepare(imu())
    seen = Observations(
        tuple(step.label for step in steps),
        made,
        np.tile(np.diag([1e-3] * 3 + [sd] * 3) ** 2, (6, 1, 1)),
        np.full(6, 10.0),
        np.full(6, 1000),
        np.arange(6, dtype=float),
        sensor.channels,
    )
    bench = Hand(Measured(9.81, 1e-3), float(np.radians(48)))
    found = METHODS["six_position"].estimator("ml")(seen, sensor, bench, steps)
    at = [found.names.index(f"g{a}.bias") for a in "xyz"]
    error, stated = found.value[:, at], found.std[..., at]
    low, high = AZIMUTHS[azimuths]
    assert low < np.sqrt(np.mean((error / stated) ** 2)) < high


def at_one_azimuth(soaks: int) -> np.ndarray:
    """Return error and u, °/h/g, of the sensitivities along P and O, from soaks in one fixture."""
    rng = np.random.default_rng(soaks)
    level = np.degrees(EARTH * np.cos(np.radians(48))) * 3600  # °/h
    up = np.array([step.up for step in six_positions() if isinstance(step, Hold)])
    north = up[:, [1, 2, 0]]  # each face keeps its azimuth in the fixture
    rate = level * north + up * np.degrees(EARTH * np.sin(np.radians(48))) * 3600
    names = [step.label for step in six_positions()]
    table = {"p": names * soaks, "T": np.repeat(20.0 + 15 * np.arange(soaks), 6)}
    force, rate = (np.tile(one, (soaks, 1)) for one in (9.81 * up, rate))
    table |= {f"a{a}": force[:, k] + rng.normal(0, 1e-4, 6 * soaks) for k, a in enumerate("xyz")}
    table |= {f"g{a}": rate[:, k] + rng.normal(0, 0.1, 6 * soaks) for k, a in enumerate("xyz")}
    found = calibrate(
        table,
        method="six_position",
        sensor={"accelerometer": {"unit": "m/s²"}, "gyro": {"unit": "°/h"}},
        bench={"gravity": "9.81 m/s² ± 0.1 mm/s²", "latitude": "48 ° ± 0.01 °", "tilt": "0.01 °"},
        kind="means",
        label="p",
        accelerometer=["ax", "ay", "az"],
        gyro=["gx", "gy", "gz"],
        temperature="T",
        sd={"accelerometer": "0.1 mm/s²", "gyro": "0.1 °/h"},
    ).calibration
    of = [f"g{a}.g_{b}" for a in "xyz" for b in "po"]
    size = np.radians(1 / 3600) / 9.80665
    return np.array([[found.value(name), found.uncertainty(name)] for name in of]).T / size


@pytest.mark.slow
def test_more_soaks_in_one_fixture_do_not_reduce_the_effect_of_the_azimuth():
    (_, once), (error, often) = at_one_azimuth(1), at_one_azimuth(5)
    assert np.abs(error).max() > 5  # °/h/g: the level part of the earth's rate
    assert (np.abs(error) < 2.5 * often).all()
    assert (often > 0.99 * once).all()

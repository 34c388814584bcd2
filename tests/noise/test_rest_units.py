"""Wrong units are noticed wherever gravity or a bias shows them, and nowhere else."""

from pathlib import Path

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.benches.generated_runs import simulate_run, write_run
from tests.program import run_program
from tests.reports import report_file

import inercal
from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.noise import analyse_noise_stream
from inercal.recordings import Recording

N, RATE = 2000, 100.0
G0 = 9.80665
LEVEL = np.array([0.02, -0.01, 0.9997]) * G0  # m/s²
TILTED = np.array([0.5, -0.7, 0.51]) * G0


def rest(mean: Array, units: tuple[str, ...], channels: tuple[str, ...] = ("ax", "ay", "az")):
    rng = np.random.default_rng(3)
    data = mean * (1 + 2e-4 * rng.standard_normal((N, 1))) + 2e-4 * rng.standard_normal(
        (N, len(mean))
    )
    return Recording(np.arange(N) / RATE, data, channels[: len(mean)], units, source="rest.csv")


def remarks(recording: Recording, gravity: float | None = G0) -> tuple[str, ...]:
    return inercal.analyse_noise(recording, terms="N", kinds=(), gravity=gravity).remarks


@pytest.mark.slow
@pytest.mark.parametrize("mean", [evidence(LEVEL), TILTED], ids=["level", "tilted"])
@pytest.mark.parametrize(
    ("size", "unit", "right"),
    [(G0, "m/s²", "g"), (1 / G0, "g", "m/s²"), (1e-3 * G0, "m/s²", "mg"), (2.1, "m/s²", ""),
     (0.4, "m/s²", "")],
)  # fmt: skip
def test_a_triad_in_another_unit_is_refused(mean: Array, size: float, unit: str, right: str):
    stored = mean / size if unit == "m/s²" else mean  # as the logger wrote it
    recording = rest(stored, (unit,) * 3)
    with pytest.raises(InputError, match=r"specific force at rest") as refused:
        inercal.analyse_noise(recording)
    assert refused.value.key == "[sensor.accelerometer] unit"
    assert (f'state unit = "{right}"' in str(refused.value)) == bool(right)
    with pytest.raises(InputError, match="specific force at rest"):
        analyse_noise_stream([recording.data], 1 / RATE, recording.channels, recording.units)
    assert remarks(recording, None) == ()


@pytest.mark.slow
def test_right_units_pass_and_a_doubtful_scale_is_said():
    assert remarks(rest(LEVEL, ("m/s²",) * 3)) == ()
    assert remarks(rest(TILTED / G0, ("g",) * 3)) == ()
    assert remarks(rest(1e3 * TILTED / G0, ("mg",) * 3)) == ()
    (doubt,) = remarks(rest(1.3 * LEVEL, ("m/s²",) * 3))
    assert "check the nominal scale" in doubt


@pytest.mark.slow
@pytest.mark.parametrize("level", [0.0, 0.003, 0.1, 1.0, -1.0])
def test_one_or_two_axes_may_have_any_inclination(level: float):
    assert remarks(rest(np.array([level * G0]), ("m/s²",))) == ()
    assert remarks(rest(np.array([level]), ("g",))) == ()
    across = np.sqrt(1 - level**2) / 3
    assert remarks(rest(np.array([level, across]), ("g",) * 2)) == ()


@pytest.mark.parametrize("axes", [1, 2, 4])
def test_no_axis_reads_more_than_gravity(axes: int):
    mean = np.array([9.8, 0.3, 0.1, -0.2])[:axes]
    names = ("a1", "a2", "a3", "a4")
    with pytest.raises(InputError, match='state unit = "m/s²"'):
        inercal.analyse_noise(rest(mean, ("g",) * axes, names))


@pytest.mark.slow
def test_a_rate_beyond_any_bias_is_said():
    gyros = ("gx", "gy", "gz")
    bias = np.array([0.5, -0.3, 0.1])  # °/s
    assert remarks(rest(bias, ("°/s",) * 3, gyros)) == ()
    (doubt,) = remarks(rest(bias, ("rad/s",) * 3, gyros))
    assert "gx 29 °/s" in doubt
    assert "gz" not in doubt


@pytest.mark.slow
def test_a_disturbed_or_moved_recording_is_judged_by_its_rests():
    moved = rest(TILTED, ("m/s²",) * 3)
    moved.data[600:900] += 5 * np.random.default_rng(4).standard_normal((300, 3))
    assert remarks(moved) == ()


def test_the_reported_log_is_refused_and_writes_nothing(tmp_path: Path):
    log = report_file("03_rest_in_g.csv")
    options = ("--set", "sensor.gyro.unit=°/s", "--to", "kalibr", "--out", tmp_path)
    ended = run_program("noise", log, *options, "--set", "sensor.accelerometer.unit=m/s²")
    assert ended.status == 2
    assert 'state unit = "g"' in ended.error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "norm", "refused"),
    [("six_position", 1.0, False), ("six_position", 20.0, True), ("centrifuge_norm", 20.0, False)],
)
def test_a_run_file_knows_whether_its_bench_carries_the_sensor_round(
    method: str, norm: float, refused: bool, tmp_path: Path
):
    path = write_run(method, tmp_path)
    file = simulate_run(path, 0).file("made.npz")
    columns = dict(np.load(file))
    noise = 1e-3 * np.random.default_rng(5).standard_normal((3, columns["time"].size))
    direction = TILTED / np.linalg.norm(TILTED)
    readings = norm * direction[:, None] + noise
    columns |= dict(zip(("ax", "ay", "az"), readings, strict=True))
    np.savez(file, allow_pickle=False, **columns)
    ended = run_program("noise", path, "--terms", "N")
    assert (ended.status == 2) == refused, ended.error
    assert ("specific force at rest" in ended.error) == refused

"""Sensors with one axis, two, or four: from the run file to corrected readings and exports."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.program import run_program
from tests.refusals import refused

from inercal.calibration import Calibration
from inercal.calibration.files import save
from inercal.export import export_calibration
from inercal.methods import METHODS
from inercal.noise import analyse_noise
from inercal.physics.motion import Motion
from inercal.physics.sensors import Sensor, axes_along
from inercal.pipeline import Outcome, apply, calibrate, simulate_files
from inercal.pipeline.drafts.rest_recording import read_rest_recording
from inercal.pipeline.operating_points import points_from_texts
from inercal.recordings import Recording
from inercal.recordings.io.write import write_recordings
from inercal.runfile import read

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples" / "single_axis"
G0 = 9.80665
DIAGONALS = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3)


@pytest.fixture(scope="module")
def cluster() -> Outcome:
    return calibrate(EXAMPLES / "cluster.toml")


@pytest.fixture(scope="module")
def player() -> Outcome:
    return calibrate(EXAMPLES / "record_player.toml")


def test_a_gyro_on_a_record_player(player: Outcome):
    assert player.verdict.grade == "consistent"
    # Its readings were made with a scale factor of 1.8 % and a bias of 1.9 °/s.
    for name, true in (("gz.scale", 0.018), ("gz.bias", np.radians(1.9))):
        error = player.calibration.value(name) - true
        assert abs(error) < 2.6 * player.calibration.uncertainty(name)
    page = (ROOT / "docs" / "how-to" / "axes.md").read_text(encoding="utf-8")
    assert f"is {100 * player.calibration.value('gz.scale'):.2f} % larger" in page


def test_the_record_player_of_a_public_report(reports_dir: Path):
    axis = calibrate(reports_dir / "08_record_player.toml").calibration
    scale = 4.55 * (1 + axis.value("gz.scale"))
    assert scale == pytest.approx(4.600, abs=5e-4)
    null = 2048 + 4.55 * np.degrees(axis.value("gz.bias"))
    assert null == pytest.approx(2040, abs=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("stated", [{}, {"data.gyro": "gyro_z"}])
def test_the_noise_of_a_single_gyro(reports_dir: Path, stated: dict[str, str]):
    log = reports_dir / "08_one_gyro.csv"
    recording = read_rest_recording(log, {"sensor.gyro.unit": "°/s"} | stated)
    assert recording.channels == ("gz",)
    (found,) = analyse_noise(recording).channels
    (walk,) = (one for one in found.coefficients if one.symbol == "N")
    assert np.degrees(walk.value) * 60 == pytest.approx(0.30, abs=2 * 0.0055)


def test_one_axis_is_corrected_to_one_column(player: Outcome):
    volts = np.array([[1.35], [1.96], [0.74]])
    rate = player.calibration.correct(volts).w
    assert rate.shape == (3, 1)
    gain = 0.006 * 180 / np.pi * (1 + player.calibration.value("gz.scale"))
    expected = (volts - 1.35) / gain - player.calibration.value("gz.bias") * (
        0.006 * 180 / np.pi / gain
    )
    assert np.allclose(rate, expected, rtol=1e-12)
    matrix, offset = player.calibration.affine_correction()
    assert np.allclose((volts - offset) @ matrix.T, rate)


def test_a_cluster_gives_a_vector_and_its_parity(cluster: Outcome):
    calibration = cluster.calibration
    assert cluster.verdict.grade == "consistent"
    force = G0 * np.array([[0.3, -0.4, 0.8]])
    sensor = calibration.sensor
    reading = sensor.to_output(sensor.forward(Motion(force), calibration.values))
    sound = calibration.correct(reading)
    assert np.allclose(sound.f, force, rtol=1e-9)
    assert sound.parity["f"][0] < 1e-9
    faulty = calibration.correct(reading + np.array([0.0, 0.0, 0.02, 0.0]))
    # One of four readings along diagonals: a quarter of its square remains.
    assert faulty.parity["f"][0] == pytest.approx(0.01 * G0, rel=0.02)


@pytest.mark.parametrize(
    ("directions", "channels"),
    [(["z"], ("wz",)), (["-z"], ("w1",)), ([[0.6, 0, 0.8], "y"], ("w1", "w2"))],
)
def test_corrected_recordings_name_their_components(
    tmp_path: Path, directions: list[object], channels: tuple[str, ...]
):
    rng = np.random.default_rng(1)
    data = rng.normal(0.02, 1e-3, (4000, len(directions)))
    temperature = 20 + 15 * np.sin(np.linspace(0, np.pi, 4000))
    names = [f"g{k}" for k in range(len(directions))]
    rows = np.column_stack([np.arange(4000) / 5, temperature, data])
    head = ",".join(["t", "T", *names])
    np.savetxt(tmp_path / "log.csv", rows, "%.6f", ",", header=head, comments="")
    (tmp_path / "run.toml").write_text(
        f"""
[sensor.gyro]
axis = {directions}
unit = "rad/s"
white = "0.03 °/s/√Hz"
bias_instability = "1 °/h"
[bench]
kind = "hand"
[data]
file = "log.csv"
time = "t"
temperature = "T"
accelerometer = []
gyro = {names}
[environment]
kind = "ramp"
lag = "0 s ± 1 s"
[method]
name = "temperature_ramp"
""",
        encoding="utf-8",
    )
    outcome = calibrate(tmp_path / "run.toml")
    corrected = apply(outcome.calibration, tmp_path / "run.toml")
    assert corrected.channels == channels
    assert outcome.calibration.predict(extrapolate=True).names == channels
    assert corrected.data.shape == data.shape


def test_an_axis_alone_is_exported_as_the_only_channel(player: Outcome, cluster: Outcome):
    text = export_calibration(player.calibration, "csv").text
    cells = [line.split(",") for line in text.splitlines() if line.startswith("C,")]
    assert [row[1:3] for row in cells] == [["wx", "gz"], ["wy", "gz"], ["wz", "gz"]]
    ideal = 1 / (0.006 * 180 / np.pi)
    scale = 1 + player.calibration.value("gz.scale")
    assert np.allclose([float(row[3]) for row in cells], [0, 0, ideal / scale], rtol=1e-12)
    with refused(names=("a1", "a2", "a3", "a4")):
        export_calibration(cluster.calibration, "c")


def test_a_method_that_needs_three_axes_says_why():
    sensor = Sensor("s", axes_along(["x", "z"], "f", "a"))
    with refused(key="[sensor.accelerometer]", names=("ax", "az")):
        METHODS["multi_position"].prepare(sensor)


def changed(folder: Path, *pairs: tuple[str, str]) -> Path:
    shutil.copytree(EXAMPLES, folder, dirs_exist_ok=True)
    path = folder / "cluster.toml"
    text = path.read_text(encoding="utf-8")
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    return path


AXIS = "axis = [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]\n"


@pytest.mark.parametrize(
    "axis",
    ["", 'axis = "x"\n', "axis = [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [0, 0, 0]]\n",
     'axis = ["x", "y", "z", "up"]\n'],
)  # fmt: skip
def test_directions_that_do_not_fit_are_refused(tmp_path: Path, axis: str):
    with refused(key="[sensor.accelerometer] axis"):
        calibrate(changed(tmp_path, (AXIS, axis)))


@pytest.mark.parametrize(
    ("columns", "axis", "faces"),
    [
        ('["s1"]', "axis = [[1, 1, -1]]\n", "z"),
        ('["s1", "s2"]', "axis = [[1, -1, -1], [1, 1, 1]]\n", "yz"),
    ],
)
def test_one_or_two_accelerometers_show_a_wrong_direction(
    tmp_path: Path, columns: str, axis: str, faces: str
):
    path = changed(tmp_path, ('["s1", "s2", "s3", "s4"]', columns), (AXIS, axis))
    with refused() as error:
        calibrate(path)
    assert error.value.names[0][0] in faces


def test_a_wrong_unit_of_one_accelerometer_is_named(tmp_path: Path):
    path = changed(
        tmp_path,
        ('["s1", "s2", "s3", "s4"]', '["s1"]'),
        (AXIS, "axis = [[1, 1, 1]]\n"),
        ('unit = "g"', 'unit = "m/s²"'),
    )
    with refused(key="[sensor.accelerometer] unit"):
        calibrate(path)


def test_a_recording_keeps_its_other_channels(player: Outcome):
    recording = Recording(
        time=np.arange(3) / 10,
        data=np.array([[0.0, 1.35], [0.0, 1.36], [0.0, 1.34]]),
        channels=("other", "gz"),
        units=("V", "V"),
    )
    assert player.calibration.correct(recording).w.shape == (3, 1)


def test_components_along_oblique_axes_are_read_back_along_them(tmp_path: Path):
    path = changed(
        tmp_path,
        ('["s1", "s2", "s3", "s4"]', '["s1", "s2"]'),
        (AXIS, "axis = [[1, 1, 1], [1, -1, -1]]\n"),
    )
    calibration = calibrate(path).calibration
    point = points_from_texts(["f = 0.3 g, -0.2 g"], calibration)
    assert np.allclose(calibration.predict(point["f"]).value, [[0.3 * G0, -0.2 * G0]], rtol=1e-9)


@pytest.mark.parametrize(
    ("axis", "is_flat"),
    [
        ("[[1, 0, 0], [0.6, 0.8, 0], [0, 1, 0], [-0.6, 0.8, 0]]", True),
        ("[[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]", False),
    ],
)
def test_apply_says_that_axes_in_a_plane_give_no_vector(tmp_path: Path, axis: str, is_flat: bool):
    path = changed(
        tmp_path,
        (AXIS, f"axis = {axis}\n"),
        ('kind = "means"\n', 'rate = "100 Hz"\n'),
        ('file = "cluster.csv"', 'file = "log.csv"'),
        ('\n[data.sd]\naccelerometer = "30 µg"\n', 'marks = "labels"\n'),
        ('unit = "g"\n', 'unit = "g"\nwhite = "60 µg/√Hz"\n'),
    )
    axes = np.array(json.loads(axis), dtype=float)
    rows = (axes / np.linalg.norm(axes, axis=1)[:, None])[:, 0] + np.zeros((50, 1))  # 1 g on x
    rows += np.random.default_rng(3).normal(0, 1e-4, rows.shape)
    lines = ["s1,s2,s3,s4,face", *(f"{','.join(f'{x:.5f}' for x in row)},x_p" for row in rows)]
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    sensor = read(path).sensor
    size = len(sensor.coefficients)
    one = Calibration(sensor, np.zeros(size), np.eye(size))
    saved = save(one, tmp_path / "one.calibration.json")
    done = run_program("apply", saved, path, "--out", tmp_path / "corrected.npz")
    assert done.status == 0, done.error
    assert ("specific force across" in done.output) is is_flat
    assert "angular rate" not in done.output


def tumbled(tmp_path: Path, axis: str) -> Path:
    """Write the run file of three accelerometers on a dividing head, with these directions."""
    whole = (ROOT / "examples" / "dividing_head" / "small_tilts.toml").read_text(encoding="utf-8")
    text, _, _ = whole.partition("warm_up = 30")
    for old, new in (
        ('unit = "g"\n', f'unit = "g"\naxis = {axis}\n'),
        ('"a.k0"', '"a1.k0"'),
        ('"a.k1"', '"a2.k1"'),
        ('"a.delta_o"', '"a3.delta_o"'),
        ('accelerometer = ["a"]', 'accelerometer = ["p", "q", "r"]'),
        ('warm_up_band = "2 µg"\n', ""),
        ('backlash = "0.1 ″"\n', ""),
    ):
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "run.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_three_accelerometers_on_a_head_are_tumbled_together(tmp_path: Path):
    path = tumbled(tmp_path, '["x", "-y", [0.6, 0.8, 0]]')
    run = read(path)
    write_recordings({run.file(name): one for name, one in simulate_files(run, 3).items()})
    outcome = calibrate(path)
    assert outcome.verdict.grade == "consistent"
    made, true = outcome.calibration, run.truth
    off = np.array([made.value(name) - true.get(name, 0.0) for name in made.sensor.coefficients])
    assert np.all(np.abs(off) < 4 * np.sqrt(np.diag(made.covariance)))
    with refused():
        export_calibration(made, "python")


@pytest.mark.parametrize("axis", ['["x", "y", "z"]', '["x", "y"]', '["y", "x", [0.6, 0.8, 0]]'])
def test_directions_that_do_not_fit_a_head_are_refused(tmp_path: Path, axis: str):
    run = read(tumbled(tmp_path, '["x", "-y", [0.6, 0.8, 0]]'))
    write_recordings({run.file(name): one for name, one in simulate_files(run, 3).items()})
    path = tumbled(tmp_path, axis)
    with refused():
        calibrate(path)

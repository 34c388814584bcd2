"""A run file is read into SI; a mistake in it is one line that names the file and the key."""

import re
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.refusals import refused
from tests.runfile.run_file_texts import FERRARIS, SIX_POSITIONS, changed, run_file

from inercal.basics.errors import InputError
from inercal.benches import Hand
from inercal.benches.hand.kind import HandSection
from inercal.physics.earth import normal_gravity
from inercal.physics.plan import Turn
from inercal.physics.section_settings import section_gravity
from inercal.physics.sensors import G0
from inercal.recordings.samples import STANDARD_GRAVITY
from inercal.runfile import read
from inercal.runfile.section_checks import check_stated_gravity

DEGREE = pi / 180


def refuse(path: Path, key: str | None, **data: Any) -> str:
    """Expect one line about a key of a run file; return it without the name of the file."""
    with refused(InputError, file=path, key=key, **data) as refusal:
        read(path)
    message = str(refusal.value)
    assert "\n" not in message
    assert message.startswith(f"{path}: ")
    return message.removeprefix(f"{path}: ")


def test_a_good_file_comes_out_in_si(tmp_path: Path):
    run = read(run_file(tmp_path, FERRARIS))
    assert (run.sensor.name, run.sensor.channels) == (
        "board 7",
        ("ax", "ay", "az", "gx", "gy", "gz"),
    )
    accelerometer, gyro = run.sensor.axes[0], run.sensor.axes[3]
    assert accelerometer.readout.scale == pytest.approx(2048 / G0, rel=1e-15)
    assert accelerometer.readout.full_scale == pytest.approx(16 * 2048)
    assert accelerometer.noise.white == pytest.approx(100e-6 * G0)
    assert gyro.readout.scale == pytest.approx(180 / pi)
    assert gyro.noise.white == pytest.approx(0.3 * DEGREE / 60)
    assert gyro.noise.bias_instability == pytest.approx(8 * DEGREE / 3600)
    assert run.truth["ax.k0"] == pytest.approx(0.032 * G0)
    assert run.truth["ay.k1"] == pytest.approx(-0.005)
    assert run.truth["gz.g_i"] == pytest.approx(110 * DEGREE / 3600 / G0)
    assert (run.bench.gravity.value, run.bench.gravity.sd) == (9.81, pytest.approx(2e-4))
    assert isinstance(run.bench, Hand)
    place = run.bench.place
    assert place is not None
    # Without ±: half a unit of the last digit, rectangular.
    assert (place.value, place.sd) == pytest.approx((47 * DEGREE, 0.5 * DEGREE / np.sqrt(3)))
    assert run.bench.turn_tilt == pytest.approx(0.3 * DEGREE)
    assert run.rate_hz == 50
    assert run.estimator == "ml"
    turns = [step for step in run.steps if isinstance(step, Turn)]
    assert [(t.angle, t.seconds) for t in turns] == [(pytest.approx(2 * pi), 4.0)] * 3
    assert {step.seconds for step in run.steps[:6]} == {4.0}
    assert len(run.sensor.coefficients) == 3 * 4 + 3 * 7


def test_the_lowest_and_highest_gravity_on_earth_are_possible():
    for value in (9.7639, 9.8337):  # Huascarán and the Arctic Ocean
        section = HandSection(gravity=f"{value} m/s² ± 20 µm/s²")
        assert section_gravity(section).value == value


@pytest.mark.parametrize(
    ("gravity", "keys", "kind"),
    [
        ("9.80665 m/s² ± 5 µm/s²", {"latitude": "50 °"}, "doubt"),
        ("1 g ± 1 µg", {"latitude": "-55 ° ± 0.1 °"}, "doubt"),
        ("9.80665 m/s² ± 5 µm/s²", {}, None),
        ("9.80665 m/s² ± 5 µm/s²", {"latitude": "50 °", "height": "1310 m"}, "note"),
        ("9.80665 m/s² ± 5 µm/s²", {"latitude": "45.5 °"}, "note"),
        ("9.80665 m/s² ± 2 mm/s²", {"latitude": "50 °"}, "note"),  # a rough value is no claim
        ("9.80672 m/s² ± 5 µm/s²", {"latitude": "50 °"}, "note"),  # measured at some height
    ],
)
def test_standard_gravity_is_doubted_where_only_a_high_laboratory_has_it(
    gravity: str, keys: dict[str, str], kind: str | None
):
    found = check_stated_gravity(HandSection(gravity=gravity, **keys))  # pyright: ignore[reportArgumentType]
    assert [one.severity for one in found] == ["note"] * bool(kind)
    assert [one.what == STANDARD_GRAVITY for one in found] == [kind == "doubt"] * bool(kind)


def test_the_height_at_which_standard_gravity_is_right_is_named():
    (found,) = check_stated_gravity(HandSection(gravity="9.80665 m/s²", latitude="50 °"))
    (height,) = re.findall(r"about (\d+) m;", found.message)
    # 9.81070 m/s² at 50° on the ellipsoid, minus the free-air gradient of 3.086 µm/s² per metre
    assert float(height) == pytest.approx((9.81070 - 9.80665) / 3.086e-6, rel=0.01)


def test_gravity_is_computed_from_latitude_and_height_where_it_is_not_stated(tmp_path: Path):
    path = run_file(tmp_path, FERRARIS, ('gravity = "9.81 m/s² ± 0.2 mm/s²"', 'height = "280 m"'))
    assert read(path).bench.gravity == normal_gravity(47 * DEGREE, 280.0)


def test_a_prior_is_a_gaussian_on_one_coefficient(tmp_path: Path):
    prior = '\n[method.prior]\n"az.k0" = "3 mg ± 0.5 mg"\n'
    (found,) = read(run_file(tmp_path, FERRARIS + prior)).priors
    assert found.names == ("az.k0",)
    assert found.mean == pytest.approx([0.003 * G0])
    assert np.sqrt(found.covariance) == pytest.approx(np.array([[0.0005 * G0]]))


def test_files_are_named_relative_to_the_run_file(tmp_path: Path):
    assert read(run_file(tmp_path, FERRARIS)).file("log.csv") == tmp_path / "log.csv"


def test_chosen_coefficients_replace_those_of_the_method(tmp_path: Path):
    chosen = ('name = "ferraris"', 'name = "ferraris"\ncoefficients = ["bias", "az.scale"]')
    names = read(run_file(tmp_path, FERRARIS, chosen)).sensor.coefficients
    assert names == ("ax.k0", "ay.k0", "az.k0", "az.k1", "gx.bias", "gy.bias", "gz.bias")


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ('tilt = "0.3 °"\nturn_a', 'tillt = "0.3 °"\nturn_a', "[bench] tillt"),
        ('[method]\nname = "f', '[method]\nnam = "f', "[method] name"),
        ('name = "ferraris"', 'name = "ferraris"\nx = 1', "[method] x"),
        ('unit = "°/s"', 'unit = "°/s"\nnoise = "1"', "[sensor.gyro] noise"),
        ("[sensor]\n", "speed = 1\n[sensor]\n", "speed"),
        ('rate = "50 Hz"', "rate = 50", "[data] rate"),
        ('marks = "found"', 'nonfinite = "ignore"', "[data] nonfinite"),
        ('unit = "°/s"', 'unit = "°/fortnight"', "[sensor.gyro] unit"),
        ('unit = "°/s"', 'unit = "m/s²"', "[sensor.gyro] unit"),
        ('scale = "2048 LSB/g"\n', "", "[sensor.accelerometer] scale"),
        ('"2048 LSB/g"', '"2048 LSB/(°/s)"', "[sensor.accelerometer] scale"),
        ('"2048 LSB/g"', '"0 LSB/g"', "[sensor.accelerometer] scale"),
        ('unit = "°/s"', 'unit = "°/s"\nscale = "16 LSB/(°/s)"', "[sensor.gyro] scale"),
        ('"16 g"', '"16 °/s"', "[sensor.accelerometer] full_scale"),
        ('"16 g"', '"0 g"', "[sensor.accelerometer] full_scale"),
        ('"100 µg/√Hz"', '"100 µg"', "[sensor.accelerometer] white"),
        ('"100 µg/√Hz"', '"-1 µg/√Hz"', "[sensor.accelerometer] white"),
        ('tilt = "0.3 °"\nturn_a', 'tilt = "-0.3 °"\nturn_a', "[bench] tilt"),
        ('tilt = "0.3 °"\nturn_a', 'tilt = "2 mm"\nturn_a', "[bench] tilt"),
        ('tilt = "0.3 °"\nturn_a', 'tilt = "0.3"\nturn_a', "[bench] tilt"),
        ("turn_angle", 'timebase = "20"\nturn_angle', "[bench] timebase"),
        ("turn_angle", 'timebase = "0.05"\nturn_angle', "[bench] timebase"),  # %?
        ('"9.81 m/s² ± 0.2 mm/s²"', '"5 m/s²"', "[bench] gravity"),
        ('"9.81 m/s² ± 0.2 mm/s²"', '"98.1 m"', "[bench] gravity"),
        ('"9.81 m/s² ± 0.2 mm/s²"', '"9.75 m/s² ± 20 µm/s²"', "[bench] gravity"),
        ('"9.81 m/s² ± 0.2 mm/s²"', '"9.9127 m/s² ± 20 µm/s²"', "[bench] gravity"),
        ('latitude = "47 °"', 'kind = "robot"', "[bench] kind"),
        ('"ax.k0" = "32 mg"', '"ax.k9" = "32 mg"', "[sensor.truth] ax.k9"),
        ('"ax.k0" = "32 mg"', '"ax.k0" = "32 °/s"', "[sensor.truth] ax.k0"),
        ('"ax.k0" = "32 mg"', '"ax.k0" = "much"', "[sensor.truth] ax.k0"),
        ('rate = "50 Hz"', 'rate = "-50 Hz"', "[data] rate"),
        ('rate = "50 Hz"', 'rate = "50 s"', "[data] rate"),
        ('turn = "360 °"', 'turn = "1 s"', "[method] turn"),
        ('seconds = "4 s"\nturn =', 'seconds = "4 m"\nturn =', "[method] seconds"),
        ('name = "ferraris"', 'name = "ferraris"\ntime_offset = true', "[method] time_offset"),
        ('name = "ferraris"', 'name = "ferraris"\nsearch = {}', "[method.search]"),
        ("[sensor]\n", '[sensor]\nframe = "symmetric"\n', "[sensor] frame"),
    ],
)
def test_a_mistake_is_refused_with_its_key(tmp_path: Path, old: str, new: str, key: str):
    refuse(run_file(tmp_path, FERRARIS, (old, new)), key)


@pytest.mark.parametrize(
    ("new", "wrong", "possible"),
    [
        ('name = "feraris"', "'feraris'", "six_position, ferraris"),
        ('name = "ferraris"\nestimator = "best"', "'best'", "ml, classical"),
        ('name = "ferraris"\ncoefficients = ["k9"]', "'k9'", "misalignment"),
        ('name = "ferraris"\ncoefficients = ["ax.k2"]', "ax.k2", "scale"),
    ],
)
def test_an_unknown_name_of_the_method_is_refused_with_those_that_exist(
    tmp_path: Path, new: str, wrong: str, possible: str
):
    path = run_file(tmp_path, FERRARIS, ('name = "ferraris"', new))
    with refused(InputError, file=path) as refusal:
        read(path)
    assert wrong in str(refusal.value)
    assert possible in str(refusal.value)


@pytest.mark.parametrize("section", ["sensor", "bench", "data", "method", "sensor.accelerometer"])
def test_a_section_that_is_missing_is_named(tmp_path: Path, section: str):
    parts = FERRARIS.split("\n\n")
    kept = [part for part in parts if not part.startswith(f"[{section}")]
    path = tmp_path / "run.toml"
    path.write_text("\n\n".join(kept), encoding="utf-8")
    message = refuse(path, f"[{section}]")
    assert section != "sensor.accelerometer" or "accelerometer = [] in [data]" in message


@pytest.mark.parametrize("value", ["3 mg", "3 mg ± 0.5 °", "three"])
def test_a_prior_that_cannot_be_used_is_refused(tmp_path: Path, value: str):
    path = run_file(tmp_path, f'{FERRARIS}\n[method.prior]\n"az.k0" = "{value}"\n')
    refuse(path, "[method.prior] az.k0")


def test_a_prior_on_what_is_not_calibrated_is_refused(tmp_path: Path):
    path = run_file(tmp_path, FERRARIS + '\n[method.prior]\n"az.k2" = "1 ± 1"\n')
    message = refuse(path, "[method.prior] az.k2", names=("az.k2",))
    assert "az.k1" in message  # what is possible


def test_neither_gravity_nor_latitude_is_refused_with_both_ways(tmp_path: Path):
    text = changed(
        FERRARIS, ('gravity = "9.81 m/s² ± 0.2 mm/s²"\n', ""), ('latitude = "47 °"\n', "")
    )
    refuse(run_file(tmp_path, text), "[bench]")


def test_turns_of_a_method_without_turns_are_refused(tmp_path: Path):
    message = refuse(run_file(tmp_path, SIX_POSITIONS + 'turn = "360 °"\n'), "[method] turn")
    assert "turn_seconds" not in message


def test_the_options_of_a_plan_are_listed_by_the_keys_of_the_run_file(tmp_path: Path):
    change = ('name = "six_position"', 'name = "ferraris"')
    gyros = ("[bench]", '[sensor.gyro]\nunit = "°/s"\n\n[bench]')
    path = run_file(tmp_path, SIX_POSITIONS + "positions = 5\n", change, gyros)
    assert refuse(path, "[method] positions").endswith("seconds, turn, turn_seconds")


def test_a_method_that_needs_gyros_refuses_a_triad(tmp_path: Path):
    path = run_file(tmp_path, SIX_POSITIONS, ('"six_position"', '"ferraris"'))
    with refused(InputError, file=path) as refusal:
        read(path)
    assert "gyros" in str(refusal.value)


@pytest.mark.parametrize("key", ["seconds", "turn_seconds"])
def test_a_step_without_duration_is_refused(tmp_path: Path, key: str):
    text = FERRARIS.replace(f'\n{key} = "4 s"', f'\n{key} = "-4 s"')
    assert text != FERRARIS
    refuse(run_file(tmp_path, text), f"[method] {key}")


@pytest.mark.parametrize("value", ["nan °", "inf °", "1e400 °"])
def test_a_tilt_that_is_no_finite_number_is_refused(tmp_path: Path, value: str):
    old = ('tilt = "0.3 °"\nturn_a', f'tilt = "{value}"\nturn_a')
    refuse(run_file(tmp_path, FERRARIS, old), "[bench] tilt")


@pytest.mark.parametrize("name", ["", "  "])
def test_a_sensor_without_a_name_is_refused(tmp_path: Path, name: str):
    text = re.sub(r"(?m)^\[sensor\]\n(name = .*\n)?", f'[sensor]\nname = "{name}"\n', FERRARIS)
    assert text != FERRARIS
    refuse(run_file(tmp_path, text), "[sensor] name")


def test_no_toml_is_refused_with_the_line(tmp_path: Path):
    path = run_file(tmp_path, FERRARIS, ('rate = "50 Hz"', 'rate = "50 Hz'))
    line = 1 + path.read_text(encoding="utf-8").split("\n").index('rate = "50 Hz')
    assert f"line {line}" in refuse(path, None, line=line)


@pytest.mark.parametrize(
    "content",
    [
        np.random.default_rng(1).integers(0, 256, 5000, dtype=np.uint8).tobytes(),
        bytes(5000),
        FERRARIS.encode("utf-16"),
        b"[" * 5000,
        b"a = " + b"[" * 100_000,
        b"a." * 5000,
        b"a = " + b"9" * 5000,
    ],
    ids=["random", "zeros", "UTF-16", "brackets", "nested", "dotted", "digits"],
)
def test_junk_is_refused_in_one_line(tmp_path: Path, content: bytes):
    path = tmp_path / "run.toml"
    path.write_bytes(content)
    assert "TOML" in refuse(path, None)


def test_an_empty_file_lacks_its_sections(tmp_path: Path):
    path = tmp_path / "run.toml"
    path.write_bytes(b"")
    refuse(path, "[sensor]")


def test_a_file_that_is_not_there_is_named(tmp_path: Path):
    refuse(tmp_path / "none.toml", None)


def test_a_folder_is_no_run_file(tmp_path: Path):
    refuse(tmp_path, None)

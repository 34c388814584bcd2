"""`inercal noise` of logs and run files: what it prints and writes, and what it refuses."""

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.noise.generator import MEMS, Truth, draw
from tests.program import run_program

UNIT = "sensor.gyro.unit=°/s"
G0 = 9.80665
TERMS = ("--terms", "NBK")  # to choose them takes most of the time


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a log of three accelerometers and three gyros at rest, and a run file."""
    folder = tmp_path_factory.mktemp("noise")
    n, dt = 4096, 0.02
    force = draw(Truth(n, dt, 100.0, 40.0, unit=1e-6 * G0), 1, 3).T + np.array([0, 0, G0])
    rate = np.degrees(draw(replace(MEMS, n=n, dt=dt), 2, 3).T)
    table = np.column_stack([dt * np.arange(n), force, rate])
    head = "time,ax,ay,az,gx,gy,gz"
    np.savetxt(folder / "log.csv", table, "%.9g", ",", header=head, comments="")
    return folder


def analysed(folder: Path, *options: str | Path) -> dict[str, dict[str, object]]:
    found = run_program("noise", folder / "log.csv", "--set", UNIT, "--json", *options)
    assert found.status == 0, found.error
    return {one["channel"]: one for one in json.loads(found.output)["channels"]}


def values(channel: dict[str, object]) -> dict[str, float]:
    coefficients = channel["coefficients"]
    assert isinstance(coefficients, list)
    return {one["symbol"]: one["value_in_unit"] for one in coefficients}


@pytest.mark.slow
def test_a_channel_that_stays_constant_for_a_while_is_not_stored(folder: Path):
    table = np.loadtxt(folder / "log.csv", delimiter=",", skiprows=1)
    table[1500:2100, 5] = table[1500, 5]
    log, head = folder / "stuck.csv", "time,ax,ay,az,gx,gy,gz"
    np.savetxt(log, table, "%.9g", ",", header=head, comments="")
    done = run_program("noise", log, "--set", UNIT, *TERMS, "--json")
    channels = {one["channel"]: one for one in json.loads(done.output)["channels"]}
    assert [name for name, one in channels.items() if one["disturbed"]] == ["gy"]
    assert not channels["gy"]["disturbances"]
    asked = ("--to", "kalibr", "--skip-disturbed", "--out", folder / "none")
    assert run_program("noise", log, "--set", UNIT, *TERMS, *asked).status == 2
    assert not (folder / "none").exists()


@pytest.fixture(scope="module")
def written(folder: Path) -> tuple[Path, dict[str, dict[str, object]]]:
    """Analyse the log once and write all files; return their folder and what was printed."""
    out = folder / "written"
    out.mkdir()
    options = ("--write", out / "noise.toml", "--to", "kalibr", "--to", "ros", *TERMS)
    return out, analysed(folder, *options, "--out", out)


@pytest.fixture(scope="module")
def found(written: tuple[Path, dict[str, dict[str, object]]]) -> dict[str, dict[str, object]]:
    return written[1]


@pytest.mark.slow
def test_a_log_is_analysed_in_the_units_of_data_sheets(found: dict[str, dict[str, object]]):
    assert list(found) == ["ax", "ay", "az", "gx", "gy", "gz"]
    assert values(found["ax"])["N"] == pytest.approx(100, rel=0.05)
    assert values(found["gz"])["N"] == pytest.approx(0.15, rel=0.05)


@pytest.mark.slow
def test_terms_and_averaging_times_are_those_that_are_asked_for(folder: Path):
    found = analysed(folder, "--terms", "NB", "--taus", "decade")
    assert all(one["model"] == ["N", "B"] for one in found.values())
    tau = found["ax"]["deviations"]["oadev"]["tau"]  # type: ignore[index]
    assert np.allclose(tau[:4], np.array([1, 2, 4, 10]) * 0.02)


def test_files_for_a_run_file_kalibr_and_ros_hold_the_printed_values(
    written: tuple[Path, dict[str, dict[str, object]]],
):
    out, found = written
    mean = np.sqrt(np.mean([values(found[one])["N"] ** 2 for one in ("gx", "gy", "gz")]))
    keys = tomllib.loads((out / "noise.toml").read_text())["sensor"]["gyro"]
    assert float(keys["white"].removesuffix(" °/√h")) == pytest.approx(mean, rel=0.01)
    kalibr = dict(
        line.split("#")[0].split(": ")
        for line in (out / "log.kalibr.yaml").read_text().splitlines()
        if not line.startswith("#")
    )
    density = float(kalibr["gyroscope_noise_density"])
    assert density == pytest.approx(mean * 2.9089e-4, rel=1e-3)
    assert float(kalibr["update_rate"]) == pytest.approx(50)
    ros = (out / "log.ros.yaml").read_text()
    variance = float(ros.split("angular_velocity_covariance: [")[1].split(",")[0])
    assert variance == pytest.approx(density**2 * 50, rel=0.1)


@pytest.mark.slow
def test_a_run_file_takes_the_noise_into_its_sections_and_keeps_the_rest(
    folder: Path, tmp_path: Path
):
    target = tmp_path / "run.toml"
    before = (
        '[sensor.gyro]\nunit = "°/s"\nwhite = "1 °/√h"  # data sheet\n\n'
        '[bench]\nlatitude = "50 °"\n'
    )
    target.write_text(before)
    log = folder / "log.csv"
    refused = run_program("noise", log, "--set", UNIT, "--write", target)
    assert refused.status == 2
    assert target.read_text() == before
    done = run_program("noise", log, "--set", UNIT, "--terms", "NB", "--write", target, "--force")
    assert done.status == 0, done.error
    content = tomllib.loads(target.read_text())
    assert content["bench"] == {"latitude": "50 °"}
    assert content["sensor"]["gyro"]["unit"] == "°/s"
    assert content["sensor"]["gyro"]["white"] != "1 °/√h"
    assert target.with_name("run.toml.previous").read_text() == before


@pytest.mark.slow
def test_the_offset_of_an_accelerometer_whose_unit_is_seen_counts(
    folder: Path, found: dict[str, dict[str, object]]
):
    offset = "sensor.accelerometer.offset=0.5"
    shifted = analysed(folder, "--set", offset, "--terms", "NB")
    assert float(str(shifted["ax"]["mean"])) == pytest.approx(float(str(found["ax"]["mean"])) - 0.5)


@pytest.mark.slow
def test_a_run_file_names_the_recording(folder: Path, found: dict[str, dict[str, object]]):
    run_file = folder / "run.toml"
    run_file.write_text(
        '[sensor]\nname = "imu 7"\n[sensor.accelerometer]\nunit = "m/s²"\n'
        '[sensor.gyro]\nunit = "°/s"\n'
        '[bench]\ngravity = "9.80 m/s² ± 0.02 m/s²"\n'
        '[data]\nfile = "log.csv"\naccelerometer = ["ax", "ay", "az"]\n'
        'gyro = ["gx", "gy", "gz"]\ntime = "time"\n[method]\nname = "multi_position"\n'
    )
    done = run_program("noise", run_file, "--json", *TERMS)
    assert done.status == 0, done.error
    by_run_file = {one["channel"]: one for one in json.loads(done.output)["channels"]}
    assert [round(values(one)["N"], 6) for one in by_run_file.values()] == [
        round(values(one)["N"], 6) for one in found.values()
    ]


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ((), "sensor.gyro.unit"),
        (("--set", UNIT, "--method", "slopes"), "--method"),
        (("--set", UNIT, "--taus", "some"), "--taus"),
        (("--set", UNIT, "--to", "rosbag"), "--to"),
        (("--set", UNIT, "--terms", "NZ"), "NZ"),
        (("--set", UNIT, "--horizon", "0"), "--horizon"),
        (("--set", UNIT, "--set", "data.gyro=a,b,c"), "data.gyro"),
        (("--set", "sensor.gyro.unit=foo"), "[sensor.gyro] unit"),
        (("--set", UNIT, "--set", "sensor.gyro.offset=none"), "sensor.gyro.offset"),
        (("--set", UNIT, "--set", "data.nonfinite=keep"), "data.nonfinite"),
        (("--set", UNIT, "--set", "sensor.gyro.white=3"), "sensor.gyro.white"),
        (("--set", UNIT, "--terms", "B", "--to", "kalibr"), "--terms"),
        (("--set", UNIT, "--terms", "B", "--to", "ros"), "--terms"),
        (("--set", UNIT, "--skip-band", "5-3"), "--skip-band"),
        (("--set", UNIT, "--skip-band", "slow"), "--skip-band"),
        (("--set", UNIT, "--skip-band", "0-99"), "--skip-band"),
    ],
)
def test_what_is_not_known_or_not_possible_is_refused_in_one_line(
    folder: Path, tmp_path: Path, options: tuple[str, ...], text: str
):
    found = run_program("noise", folder / "log.csv", *options, "--report", "--out", tmp_path)
    assert found.status == 2
    assert found.error.startswith("inercal: ")
    assert text in found.error
    assert not list(tmp_path.iterdir())

"""The noise of a data sheet: what its numbers mean, its files, and beside a recording."""

import json
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import butter, sosfilt, welch
from tests.noise.generator import MEMS, Truth, draw, flicker_means
from tests.program import run_program

from inercal.basics.errors import InputError
from inercal.laboratory.store import Register
from inercal.noise import analyse_noise
from inercal.noise.data_sheet import SheetComparison, compare_with_sheet, noise_bandwidth
from inercal.noise.deviations import deviations
from inercal.recordings import Recording
from inercal.runfile.noise_data_sheet import read_noise_data_sheet

ROOT = Path(__file__).parents[2]
G0 = 9.80665
SHEET = {
    "name": '"IMU 5"',
    "rate": '"200 Hz"',
    "gyro": {
        "white": '"0.0035 °/s/√Hz"',
        "white_kind": '"density"',
        "bias_instability": '"3.3 °/h"',
        "bias_instability_kind": '"minimum"',
    },
    "accelerometer": {
        "white": '"0.06 m/s/√h"',
        "white_kind": '"random walk"',
        "bias_instability": '"40 µg"',
        "bias_instability_kind": '"coefficient"',
    },
}


def write_sheet(folder: Path, **gyro: str | None) -> Path:
    """Write the data sheet, with keys of its gyros changed or, for None, left out."""
    path = folder / "imu5.toml"
    lines = ["[datasheet]", *(f"{key} = {SHEET[key]}" for key in ("name", "rate"))]
    for quantity, changes in (("gyro", gyro), ("accelerometer", {})):
        keys: Mapping[str, str | None] = {**SHEET[quantity], **changes}  # type: ignore[dict-item]
        lines.append(f"[datasheet.{quantity}]")
        lines += [f"{key} = {value}" for key, value in keys.items() if value is not None]
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def imported(path: Path, *options: str | Path) -> dict[tuple[str, str], dict[str, Any]]:
    found = run_program("noise", "--datasheet", path, "--json", *options)
    assert found.status == 0, found.error
    content = json.loads(found.output)["data_sheet"]
    return {(one["quantity"], one["symbol"]): one for one in content["coefficients"]}


def test_the_two_numbers_of_one_noise_agree_when_each_is_called_what_it_is(tmp_path: Path):
    density = imported(write_sheet(tmp_path))["gyro", "N"]
    walk = {"white": '"0.1485 °/√h"', "white_kind": '"random walk"'}
    named = imported(write_sheet(tmp_path, **walk))["gyro", "N"]
    assert density["values"] == pytest.approx(named["values"], rel=1e-3)
    assert density["values_in_unit"] == pytest.approx([0.0035 * 60 / 2**0.5], rel=1e-9)


def test_a_density_is_the_root_of_a_one_sided_spectrum():
    # White noise of N = 1: σ²(τ) = 1/τ, so that samples have the variance 1/Δ.
    dt = 0.01
    y = np.random.default_rng(1).standard_normal(1 << 18) / dt**0.5
    _, one_sided = welch(y, 1 / dt, nperseg=256, scaling="density")
    assert np.sqrt(np.median(one_sided)) == pytest.approx(2**0.5, rel=0.01)


@pytest.mark.parametrize(("kind", "order"), [("first order", 1), ("second order", 2)])
def test_rms_within_the_band_of_a_filter_is_that_of_filtered_white_noise(kind: str, order: int):
    dt, corner = 0.0005, 20.0
    y = np.random.default_rng(2).standard_normal(1 << 19) / dt**0.5
    kept = sosfilt(butter(order, corner, fs=1 / dt, output="sos"), y)
    rms = float(np.std(kept))
    white = rms / (2 * noise_bandwidth(corner, kind)) ** 0.5  # type: ignore[arg-type]
    assert white == pytest.approx(1.0, rel=0.02)


def test_a_minimum_is_0_664_of_the_coefficient(tmp_path: Path):
    found = imported(write_sheet(tmp_path))["gyro", "B"]
    assert found["values_in_unit"] == pytest.approx([3.3 / 0.664283], rel=1e-4)
    y = flicker_means(np.random.default_rng(3), 1 << 15, 1.0)[0]
    floor = float(np.median(deviations(y, 1.0, "oadev").value[3:9]))
    assert floor == pytest.approx(0.6643, rel=0.05)
    kind = {"bias_instability_kind": '"coefficient"'}
    plain = imported(write_sheet(tmp_path, **kind))["gyro", "B"]
    assert plain["values_in_unit"] == pytest.approx([3.3])


def test_a_minimum_gives_back_the_coefficients_whose_deviation_has_it(tmp_path: Path):
    white, flicker, walk = 9.0, 5.0, 0.2  # °/h √s, °/h, °/h/√s
    tau = np.geomspace(1, 1e4, 40_001)
    squares = white**2 / tau + 2 * np.log(2) / np.pi * flicker**2 + walk**2 * tau / 3
    least = float(np.sqrt(squares.min()))
    keys = {
        "white": f'"{white / 60} °/√h"',
        "white_kind": '"random walk"',
        "random_walk": f'"{walk} °/h/√s"',
    }
    found = imported(write_sheet(tmp_path, **keys, bias_instability=f'"{least:.9f} °/h"'))
    assert found["gyro", "B"]["values_in_unit"] == pytest.approx([flicker], rel=1e-6)
    assert [symbol for quantity, symbol in found if quantity == "gyro"] == ["N", "B", "K"]
    low = run_program(
        "noise",
        "--datasheet",
        write_sheet(tmp_path, **keys, bias_instability='"1.4 °/h"'),
    )
    assert low.status == 2
    assert "1.44 °/h" in low.error


@pytest.mark.slow
def test_values_of_three_axes_are_one_root_mean_square_for_a_triad(tmp_path: Path):
    sheet = write_sheet(tmp_path, white='["1 °/√h", "2 °/√h", "3 °/√h"]',
                        white_kind='"random walk"')  # fmt: skip
    target = tmp_path / "run.toml"
    options = ("--write", target, "--to", "kalibr", "--to", "ros", "--to", "filter")
    found = imported(sheet, *options, "--out", tmp_path)
    assert found["gyro", "N"]["values_in_unit"] == pytest.approx([1, 2, 3])
    keys = tomllib.loads(target.read_text(encoding="utf-8"))["sensor"]["gyro"]
    assert keys["white"] == "2.16 °/√h"
    assert keys["bias_instability"] == "4.968 °/h"
    assert "random_walk" not in keys
    ros = (tmp_path / "imu5.ros.yaml").read_text(encoding="utf-8")
    row = ros.split("angular_velocity_covariance: [")[1].split("]")[0].split(", ")
    variances = [float(row[k]) for k in (0, 4, 8)]
    size = np.radians(1) / 60
    assert variances == pytest.approx([200 * (one * size) ** 2 for one in (1, 2, 3)], rel=1e-5)
    kalibr = (tmp_path / "imu5.kalibr.yaml").read_text(encoding="utf-8")
    assert float(kalibr.split("gyroscope_noise_density: ")[1].split()[0]) == pytest.approx(
        size * (14 / 3) ** 0.5, rel=1e-5
    )
    assert "update_rate: 200" in kalibr
    assert "step: 0.005" in (tmp_path / "imu5.filter.yaml").read_text(encoding="utf-8")


@pytest.mark.slow
def test_noise_of_a_data_sheet_gives_way_to_a_measured_one_in_a_run_file(tmp_path: Path):
    target = tmp_path / "run.toml"
    for _ in range(2):
        options = ("--write", target, "--force")
        imported(write_sheet(tmp_path), *options)
    text = target.read_text(encoding="utf-8")
    assert text.count("white =") == 2
    log = write_log(tmp_path)
    done = run_program(
        "noise", log, "--set", "sensor.gyro.unit=°/s", "--terms", "NB", "--write", target, "--force"
    )
    assert done.status == 0, done.error
    lines = target.read_text(encoding="utf-8").splitlines()
    white = [line for line in lines if line.startswith("white =")]
    assert len(white) == 2
    assert not any("data sheet" in line for line in white)


def write_log(folder: Path) -> Path:
    """Write a log of gyros with N = .15 °/√h, and of accelerometers with N = 100 µg/√Hz."""
    n, dt = 4096, 0.02
    force = draw(Truth(n, dt, 100.0, 40.0, unit=1e-6 * G0), 1, 3).T + np.array([0, 0, G0])
    rate = np.degrees(draw(Truth(n, dt, 9.0, unit=MEMS.unit), 2, 3).T)
    table = np.column_stack([dt * np.arange(n), force, rate])
    path = folder / "log.csv"
    head = "time,ax,ay,az,gx,gy,gz"
    np.savetxt(path, table, "%.9g", ",", header=head, comments="")
    return path


@pytest.mark.slow
def test_a_recording_is_compared_with_a_data_sheet_channel_by_channel(tmp_path: Path):
    log = write_log(tmp_path)
    options = ("--set", "sensor.gyro.unit=°/s", "--datasheet", write_sheet(tmp_path))
    done = run_program("noise", log, *options, "--terms", "NB", "--json")
    assert done.status == 0, done.error
    content = json.loads(done.output)
    rows = {(one["channel"], one["symbol"]): one for one in content["data_sheet"]["comparison"]}
    assert len(rows) == 12
    measured = {
        (channel["channel"], one["symbol"]): one["value"]
        for channel in content["channels"]
        for one in channel["coefficients"]
    }
    for axis in ("gx", "gy", "gz"):
        one = rows[axis, "N"]
        assert one["ratio"] == pytest.approx(0.15 / 0.1485, rel=0.1)
        assert one["ratio"] == pytest.approx(measured[axis, "N"] / one["data_sheet"])
        assert one["ratio_u"] == pytest.approx(one["u"] / one["data_sheet"])
    assert rows["ax", "N"]["ratio"] == pytest.approx(100 / (0.06 * 1699.5), rel=0.1)
    assert not any("check white_kind" in one for one in content["data_sheet"]["remarks"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("white", "kind"), [('"0.0035 °/s/√Hz"', '"random walk"'), ('"0.15 °/√h"', '"density"')]
)
def test_a_ratio_of_the_root_of_two_names_the_other_kind(tmp_path: Path, white: str, kind: str):
    log = write_log(tmp_path)
    sheet = write_sheet(tmp_path, white=white, white_kind=kind)
    options = ("--set", "sensor.gyro.unit=°/s", "--datasheet", sheet)
    done = run_program("noise", log, *options, "--json", "--terms", "N")
    assert done.status == 0, done.error
    remarks = json.loads(done.output)["data_sheet"]["remarks"]
    assert sum("times the data sheet's" in one for one in remarks) == 1


@pytest.mark.slow
def test_a_page_shows_the_data_sheet_and_the_register_keeps_the_sensor_s_name(tmp_path: Path):
    log, register = tmp_path / "log.csv", tmp_path / "register.db"
    rate = np.degrees(draw(replace(MEMS, n=1024), 2, 3).T)
    table = np.column_stack([MEMS.dt * np.arange(1024), rate])
    np.savetxt(log, table, "%.9g", ",", header="time,gx,gy,gz", comments="")
    unit = ("--set", "sensor.gyro.unit=°/s", "--terms", "N")
    entry = ("--register", register, "--sensor", "imu 7", "--datasheet", write_sheet(tmp_path))
    done = run_program("noise", log, *unit, *entry, "--report", "--out", tmp_path)
    assert done.status == 0, done.error
    page = (tmp_path / "log.noise.html").read_text(encoding="utf-8")
    assert page.split('id="data-sheet"')[1].split("</section>")[0].count('<th scope="row">') == 6
    with Register(str(register), create=False) as opened:
        assert [one.name for one in opened.sensors()] == ["imu 7"]


@pytest.mark.parametrize(
    ("changes", "texts"),
    [
        ({"white_kind": None}, ('N = 0.148 °/√h as "density"', 'N = 0.21 °/√h as "random walk"')),
        ({"bias_instability_kind": None}, ("4.97 °/h", '3.3 °/h as "coefficient"')),
        ({"white_kind": '"spectrum"'}, ("white_kind", "density", "random walk")),
        ({"white": '"8 °/h"'}, ("[datasheet.gyro] white",)),
        ({"white": '"0.1 ± 0.01 °/√h"'}, ("[datasheet.gyro] white",)),
        ({"white": '"0 °/√h"'}, ("must be positive",)),
        ({"white": '["1 °/√h", "1 °/√h"]'}, ("[datasheet.gyro] white",)),
        ({"white": None}, ("white_kind",)),
        ({"rms": '"0.1 °/s"'}, ("white and rms",)),
        ({"white": None, "white_kind": None, "rms": '"0.1 °/s"'}, ("bandwidth",)),
        (
            {"white": None, "white_kind": None, "rms": '"0.1 °/s"', "bandwidth": '"50 Hz"'},
            ("bandwidth_kind", '0.6 °/√h as "noise"', "first order"),
        ),
        ({"bandwidth": '"50 Hz"'}, ("bandwidth", "rms")),
        ({"density": '"1 °/√h"'}, ("density", "white")),
    ],
)
def test_a_number_without_its_meaning_is_refused_with_what_it_could_mean(
    tmp_path: Path, changes: dict[str, str | None], texts: tuple[str, ...]
):
    sheet = write_sheet(tmp_path, **changes)
    target = tmp_path / "run.toml"
    found = run_program("noise", "--datasheet", sheet, "--write", target)
    assert found.status == 2
    assert found.error.startswith(f"inercal: {sheet}: ")
    for text in texts:
        assert text in found.error
    assert not target.exists()


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (("--terms", "NB"), "--terms"),
        (("--report",), "--report"),
        (("--register", "r.db"), "--register"),
        (("--to", "rosbag"), "--to"),
    ],
)
def test_options_of_recordings_are_refused_of_a_data_sheet_alone(
    tmp_path: Path, options: tuple[str, ...], text: str
):
    found = run_program("noise", "--datasheet", write_sheet(tmp_path), *options)
    assert found.status == 2
    assert text in found.error


def test_neither_a_recording_nor_a_data_sheet_is_refused():
    found = run_program("noise")
    assert found.status == 2
    assert "--datasheet" in found.error


def test_a_rate_is_needed_for_other_programs_and_not_for_a_run_file(tmp_path: Path):
    sheet = write_sheet(tmp_path)
    text = sheet.read_text(encoding="utf-8").replace('rate = "200 Hz"\n', "")
    sheet.write_text(text, encoding="utf-8")
    for program in ("kalibr", "ros", "filter"):
        found = run_program("noise", "--datasheet", sheet, "--to", program, "--out", tmp_path)
        assert found.status == 2
        assert "[datasheet]" in found.error
    imported(sheet, "--write", tmp_path / "run.toml")


def test_three_values_do_not_fit_a_recording_of_two_gyros(tmp_path: Path):
    sheet = read_noise_data_sheet(write_sheet(tmp_path, white='["1 °/√h", "2 °/√h", "3 °/√h"]'))
    y = draw(replace(MEMS, n=1024), 3, 2)
    recording = Recording(MEMS.dt * np.arange(1024.0), y.T, ("gx", "gy"), ("rad/s",) * 2)
    analysis = analyse_noise(recording, terms="N", kinds=())
    with pytest.raises(InputError, match="3 axes"):
        compare_with_sheet(analysis, sheet)
    other = replace(sheet, coefficients={"accelerometer": sheet.coefficients["accelerometer"]})
    with pytest.raises(InputError, match=r"accelerometers.*no channel"):
        compare_with_sheet(analysis, other)


def test_the_page_shows_the_example_and_states_its_numbers():
    example = ROOT / "examples" / "noise" / "data_sheet.toml"
    page = (ROOT / "docs" / "how-to" / "noise.md").read_text(encoding="utf-8")
    assert f"```toml\n{example.read_text(encoding='utf-8')}```" in page
    stated = f"N = {imported(example)['gyro', 'N']['values_in_unit'][0]:.3f} °/√h"
    assert stated in " ".join(page.split())
    sheet = read_noise_data_sheet(example)
    rms = sheet.coefficient("accelerometer", "N")
    assert rms is not None
    assert rms.mean == pytest.approx(1.2e-3 * G0 / (np.pi * 50) ** 0.5)


@pytest.mark.parametrize(
    ("value", "u", "limit", "holds"),
    [(0.9, 0.05, None, "yes"), (0.95, 0.05, None, "open"), (1.05, 0.05, None, "open"),
     (1.1, 0.05, None, "no"), (0.0, np.inf, 0.9, "yes"), (0.0, np.inf, 1.1, "open"),
     (0.0, np.inf, None, "open")],
)  # fmt: skip
def test_a_value_is_compared_with_its_limit_at_95_percent(
    value: float, u: float, limit: float | None, holds: str
):
    assert SheetComparison("gx", "gyro", "N", value, u, limit, 1.0).holds == holds

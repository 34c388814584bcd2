"""Noise analyses in the register: entered once, read back, and compared over time."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import create_engine
from tests.noise.generator import MEMS, draw
from tests.program import run_program
from tests.refusals import refused
from tests.store.calibration_generator import ten

from inercal.basics.errors import InputError
from inercal.laboratory.store import Register, backup_register, noise_trends, restore_register
from inercal.laboratory.store.connection import resolve_address
from inercal.noise import NoiseAnalysis, analyse_noise
from inercal.recordings import Recording


def analysis(seed: int, factor: float = 1.0) -> NoiseAnalysis:
    y = draw(replace(MEMS, n=4096, white=factor * MEMS.white), seed, 3)
    names = ("gx", "gy", "gz")
    recording = Recording(MEMS.dt * np.arange(4096.0), y.T, names, ("rad/s",) * 3,
                          source=f"rest{seed}.csv", sha256=f"{seed:064d}")  # fmt: skip
    return analyse_noise(recording, terms="NB", kinds=())


@pytest.fixture(scope="module")
def three() -> list[NoiseAnalysis]:
    """Return two analyses of the same noise, and one of white noise half as large again."""
    return [analysis(1), analysis(2), analysis(3, 1.5)]


def entered(address: str, three: list[NoiseAnalysis]) -> None:
    with Register(address, "A. Tester") as register:
        for month, one in enumerate(three, 1):
            register.enter_noise(one, "gyro 7", f"2026-0{month}-01")


@pytest.mark.slow
def test_analyses_are_read_back_as_they_were_entered(address: str, three: list[NoiseAnalysis]):
    entered(address, three)
    with Register(address) as register:
        found = register.noise_history("gyro 7")
        assert register.sensor("gyro 7").axes == ("gx", "gy", "gz")
        again = register.enter_noise(three[1], "gyro 7", "2027-01-01")
        assert again == found[1].id
        assert register.noise_history("gyro 7") == found
    assert [one.measured[:10] for one in found] == ["2026-01-01", "2026-02-01", "2026-03-01"]
    assert [one.by for one in found] == ["A. Tester"] * 3
    for entry, one in zip(found, three, strict=True):
        assert (entry.source, entry.recording_sha256) == (one.source, one.sha256)
        for channel in one.channels:
            for kept, own in zip(
                entry.coefficients[channel.channel], channel.coefficients, strict=True
            ):
                assert (kept.symbol, kept.value, kept.u, kept.low, kept.high, kept.unit) == (
                    own.symbol, own.value, own.u, own.low, own.high, own.unit,
                )  # fmt: skip
        assert json.loads(entry.content)["channels"][0]["channel"] == "gx"


def test_white_noise_that_grew_by_half_is_a_change_and_that_of_a_repeat_is_none(
    address: str, three: list[NoiseAnalysis]
):
    entered(address, three)
    with Register(address) as register:
        trends = noise_trends(register.noise_history("gyro 7"))
    white = [one for one in trends if one.symbol == "N"]
    assert [one.channel for one in white] == ["gx", "gy", "gz"]
    for one in white:
        first, repeat, grown = one.normalised_errors
        assert first is None
        assert repeat is not None
        assert repeat < 1
        assert grown is not None
        assert grown > 5
        assert one.changed


def test_two_analyses_of_one_recording_are_no_repeats(address: str, three: list[NoiseAnalysis]):
    entered(address, three[:1])
    other = replace(three[0], remarks=("analysed again",))
    with Register(address) as register:
        number = register.enter_noise(other, "gyro 7", "2026-01-01")
        found = register.noise_history("gyro 7")
        assert len(found) == 2
        (white, *_) = noise_trends(found)
    assert [one.id for one in white.entries] == [number]


def test_a_sensor_that_is_known_keeps_its_axes(
    address: str, tmp_path: Path, three: list[NoiseAnalysis]
):
    with Register(address) as register:
        register.enter_calibrations(ten(tmp_path))
        before = register.sensors()[0]
        register.enter_noise(three[0], before.name)
        assert register.sensor(before.id).axes == before.axes
        assert register.history(before.id).sensor.name == before.name


def test_a_changed_content_and_a_wrong_date_are_refused(address: str, three: list[NoiseAnalysis]):
    entered(address, three[:1])
    with Register(address) as register, refused(InputError, key="--measured"):
        register.enter_noise(three[1], "gyro 7", "yesterday")
    engine = create_engine(resolve_address(address).url)
    with engine.begin() as db:
        db.exec_driver_sql("UPDATE noise_analysis SET content = '{}'")
    engine.dispose()
    with Register(address) as register, refused(InputError, key="--register"):
        register.noise_history("gyro 7")


def test_a_backup_has_the_noise_analyses(address: str, tmp_path: Path, three: list[NoiseAnalysis]):
    entered(address, three)
    backup_register(address, tmp_path / "copy.db")
    restore_register(tmp_path / "copy.db", str(tmp_path / "new.db"))
    with Register(address) as old, Register(str(tmp_path / "new.db")) as new:
        assert old.noise_history("gyro 7") == new.noise_history("gyro 7")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("noise")
    y = np.degrees(draw(replace(MEMS, n=4096), 2, 3).T)
    force = 1e-3 * np.random.default_rng(3).standard_normal(y.shape) + np.array([0, 0, 9.81])
    table = np.column_stack([MEMS.dt * np.arange(len(y)), force, y])
    head = "time,ax,ay,az,gx,gy,gz"
    np.savetxt(folder / "log.csv", table, "%.9g", ",", header=head, comments="")
    return folder / "log.csv"


@pytest.mark.slow
def test_the_verb_enters_an_analysis_and_the_history_shows_it(log: Path, tmp_path: Path):
    register = tmp_path / "register.db"
    options = ("--set", "sensor.gyro.unit=°/s", "--register", register, "--measured", "2026-03-01")
    done = run_program("noise", log, *options, "--terms", "NB", "--sensor", "imu 1", "--json")
    assert done.status == 0, done.error
    assert json.loads(done.output)["entered"]["sensor"] == "imu 1"
    alone = run_program("store", "history", "imu 1", "--register", register)
    assert alone.status == 0, alone.error
    assert "no calibration yet" in alone.output
    found = json.loads(
        run_program("store", "history", "imu 1", "--register", register, "--json").output
    )
    (one,) = found["noise"]
    white = [c for c in one["coefficients"] if c["symbol"] == "N"]
    assert [c["unit"] for c in white] == ["µg/√Hz"] * 3 + ["°/√h"] * 3


@pytest.mark.slow
def test_the_page_of_a_calibrated_sensor_shows_its_noise(
    tmp_path: Path, three: list[NoiseAnalysis]
):
    address, page = str(tmp_path / "register.db"), tmp_path / "history.html"
    with Register(address) as register:
        register.enter_calibrations(ten(tmp_path))
        name = register.sensors()[0].name
        without = run_program("store", "history", name, "--register", address, "--out", page)
        assert without.status == 0, without.error
        assert 'id="noise"' not in page.read_text()
        for month, one in enumerate(three, 1):
            register.enter_noise(one, name, f"2026-0{month}-01")
    done = run_program("store", "history", name, "--register", address, "--out", page)
    assert done.status == 0, done.error
    text = page.read_text()
    assert 'id="noise"' in text
    assert "rest3.csv" in text
    assert "gx N" in done.output


@pytest.mark.parametrize(
    ("options", "key"),
    [
        (("--register", "r.db"), "--sensor"),
        (("--sensor", "imu 1"), "--sensor"),
        (("--register", "r.db", "--sensor", "imu 1", "--measured", "soon"), "--measured"),
    ],
)
def test_what_the_register_cannot_take_is_refused_before_the_work(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], key: str
):
    monkeypatch.chdir(tmp_path)
    done = run_program("noise", log, "--set", "sensor.gyro.unit=°/s", *options)
    assert done.status == 2
    assert key in done.error
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_run_file_names_the_sensor(log: Path, tmp_path: Path):
    run_file, register = log.with_name("run.toml"), tmp_path / "register.db"
    run_file.write_text(
        '[sensor]\nname = "imu 9"\n[sensor.accelerometer]\nunit = "m/s²"\n'
        '[sensor.gyro]\nunit = "°/s"\n[bench]\ngravity = "9.80 m/s² ± 0.02 m/s²"\n'
        '[data]\nfile = "log.csv"\naccelerometer = ["ax", "ay", "az"]\n'
        'gyro = ["gx", "gy", "gz"]\ntime = "time"\ntime_unit = "s"\n'
        '[method]\nname = "multi_position"\n'
    )
    done = run_program("noise", run_file, "--terms", "NB", "--register", register)
    assert done.status == 0, done.error
    with Register(str(register)) as opened:
        (found,) = opened.noise_history("imu 9")
    assert list(found.coefficients) == ["ax", "ay", "az", "gx", "gy", "gz"]
    assert found.measured_from == "entered"


def test_show_states_the_newest_noise_with_its_date_and_u(
    tmp_path: Path, three: list[NoiseAnalysis]
):
    address = str(tmp_path / "register.db")
    with Register(address) as register:
        register.enter_noise(three[0], "gyro 7", "2026-01-01")
        register.enter_noise(three[2], "gyro 7", "2026-03-01")
    done = run_program("store", "show", "gyro 7", "--register", address)
    assert done.status == 0, done.error
    rows = [
        [cell.strip() for cell in line.strip("│ ").split("│")]
        for line in done.output.splitlines()
        if line.startswith("│")
    ]
    white = {row[0]: row for row in rows if row[1] == "N"}
    for channel in three[2].channels:
        found, size = channel.coefficient("N"), np.radians(1) / 60
        assert found is not None
        value, spread, unit, date, number = white[channel.channel][2:]
        assert float(value) == pytest.approx(found.value / size, rel=0.01)
        assert float(spread) == pytest.approx(2 * found.u / size, rel=0.05)
        assert (unit, date, number) == ("°/√h", "2026-03-01", "2")
    found_json = run_program("store", "show", "gyro 7", "--register", address, "--json")
    content = json.loads(found_json.output)
    assert content["calibrations"] == content["runs"] == []
    assert [one["measured"][:10] for one in content["noise"]] == ["2026-01-01", "2026-03-01"]


@pytest.mark.slow
def test_a_sensor_without_calibrations_has_a_page_of_its_noise(
    tmp_path: Path, three: list[NoiseAnalysis]
):
    address, page = str(tmp_path / "register.db"), tmp_path / "history.html"
    entered(address, three)
    done = run_program("store", "history", "gyro 7", "--register", address, "--out", page)
    assert done.status == 0, done.error
    text = page.read_text(encoding="utf-8")
    assert 'id="noise"' in text
    assert "rest3.csv" in text
    assert "2026-01-01 to 2026-03-01" in text

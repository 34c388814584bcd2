"""`inercal predict`: what it prints and writes, and what it refuses."""

import csv
import json
import re
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from tests.program import run_program

from inercal.calibration import Calibration, Validity
from inercal.calibration.detectability import UndetectableCause
from inercal.calibration.files import load, save
from inercal.calibration.grade import Verdict
from inercal.physics.sensors import G0, Sensor, axes_along, imu, single

RATE = np.radians(100)
WIDEST = 100  # characters of a line


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with calibrations of an IMU and of one accelerometer."""
    sensor = imu().with_coefficients("bias", "scale", "misalignment", "g", "k0_dT")
    u = 1e-5 * sensor.unit_scale
    validity = Validity((-RATE, RATE), (-1.2 * G0, 1.2 * G0), (263.15, 323.15))
    causes = (
        UndetectableCause("k2", "ax.k2", 2e-5),
        UndetectableCause("scale3", "gx.scale3", 1e-4),
    )
    found = Calibration(
        sensor, 10 * u, np.diag(u**2), "ferraris", shared=(), validity=validity,
        verdict=Verdict("consistent", undetectable=causes),
    )  # fmt: skip
    save(found, tmp_path / "imu.calibration.json")
    one = single().with_coefficients("k0", "k1")
    save(
        replace(found, sensor=one, values=np.zeros(2), covariance=1e-8 * np.eye(2)),
        tmp_path / "one.calibration.json",
    )
    return tmp_path


def test_a_point_is_printed_with_units_in_lines_that_fit(folder: Path):
    at = "f = 0.5 g, -1 g, 0; w = 0, 0, 30 °/s; T = 40 °C"
    done = run_program("predict", folder / "imu.calibration.json", "--at", at)
    assert (done.status, done.error) == (0, "")
    lines = done.output.splitlines()
    assert max(map(len, lines)) <= WIDEST
    rows = {line.split("│")[1].strip(): line for line in lines if line.startswith("│")}
    assert [name for name in rows if name[0] in "fw"] == ["fx", "fy", "fz", "wx", "wy", "wz"]
    for names in ("fx fy fz", "wx wy wz"):  # one unit in each column
        units = {tuple(re.findall(r"µg|mg|g|°/s|°/h", rows[name])) for name in names.split()}
        assert len(units) == 1
        assert len(units.pop()) == 3
    assert {"bias", "scale factor", "temperature", "g-sensitivity"} < set(rows)


def test_the_object_is_in_si_and_agrees_with_python(folder: Path):
    path = folder / "imu.calibration.json"
    at = "f = 0.5 g, -1 g, 0; w = 0, 0, 30 °/s; T = 313.15 K"
    done = run_program("predict", path, "--at", at, "--at", "f=0,0,0", "--json")
    content = json.loads(done.output)
    assert content["temperature"] == [313.15, pytest.approx(293.15)]
    assert content["f"] == [[0.5 * G0, -G0, 0], [0, 0, 0]]
    assert content["outside"] == [[], []]
    found = load(path).predict(content["f"], content["w"], content["temperature"])
    np.testing.assert_allclose(content["expanded"], found.expanded)
    np.testing.assert_allclose(content["raw_error"], found.raw_error)
    for causes in (content["groups"], content["bench"]):
        np.testing.assert_allclose(sum(map(np.array, causes.values())), np.ones((2, 6)))


def test_one_number_along_the_axis_is_enough_for_one_accelerometer(folder: Path):
    path = folder / "one.calibration.json"
    done = run_program("predict", path, "--at", "f = 0.5 g", "--json")
    assert json.loads(done.output)["f"] == [[0.5 * G0, 0, 0]]
    assert run_program("predict", path, "--at", "f = 0.5 g, 0").status == 2


def test_a_table_of_points_in_any_unit_gives_a_table_with_units(folder: Path):
    points, out = folder / "points.csv", folder / "out.csv"
    points.write_text("fx [m/s²],wz [rad/s],T [K]\n4.903325,0.5,300\n-9.80665,0,290\n")
    words = ("predict", folder / "imu.calibration.json", "--points", points, "--out", out)
    assert run_program(*words).status == 0
    first, second = csv.DictReader(out.read_text(encoding="utf-8").splitlines())
    assert float(first["fx [g]"]) == 0.5
    assert float(first["wz [°/s]"]) == pytest.approx(np.degrees(0.5))
    assert float(second["T [°C]"]) == pytest.approx(16.85)
    assert float(second["fx corrected [g]"]) == -1
    assert float(first["fx U [g]"]) > 0
    # The bias counts 1, the scale factor 0.5², and the g-sensitivity to 0.5 g as much.
    assert float(first["wz share of scale factor [%]"]) == pytest.approx(25 / 1.5, abs=0.01)
    assert first["inside"] == "yes"
    again = run_program(*words)
    assert (again.status, again.error.count("\n")) == (2, 1)
    assert run_program(*words, "--force").status == 0


@pytest.mark.parametrize(
    "sweep", ["fx = -1 g … 1 g", "wz = -50 °/s to 50 °/s", "T = 0 °C ... 40 °C"]
)
def test_a_sweep_gives_a_page_that_needs_no_other_file(folder: Path, sweep: str):
    out = folder / "page.html"
    done = run_program(
        "predict", folder / "imu.calibration.json", "--sweep", sweep, "--at", "w = 1 °/s, 0, 0",
        "--out", out,
    )  # fmt: skip
    assert (done.status, done.error) == (0, "")
    page = out.read_text(encoding="utf-8")
    assert page.count("<svg") in (2, 4)
    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org", "")
    unit = {"f": "g", "w": "°/s", "T": "°C"}[sweep[0]]
    assert f"{sweep.split()[0]} [{unit}]" in page
    assert "shaded" not in page


@pytest.mark.slow
def test_a_sweep_beyond_the_validity_shades_what_is_outside(folder: Path):
    out = folder / "page.html"
    words = ("predict", folder / "imu.calibration.json", "--sweep", "fx = 0 … 3 g", "--out", out)
    assert run_program(*words).status == 2
    assert not out.exists()
    assert run_program(*words, "--extrapolate").status == 0
    assert "shaded" in out.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("--at", "f = 1, 0, 0 g"), "--at f"),
        (("--at", "f = 1 g"), "--at f"),
        (("--at", "q = 1 g"), "--at"),
        (("--at", "f = 1 g, 0, 0; f = 0, 0, 0"), "--at"),
        (("--at", "w = 1 g, 0, 0"), "--at w"),
        (("--at", "T = 20"), "--at T"),
        (("--at", "T = 20 °C, 30 °C"), "--at T"),
        (("--at", "T = -400 °C", "--extrapolate"), "−273.15 °C"),
        (("--at", "T = -273.15 °C", "--extrapolate"), "−273.15 °C"),
        (("--sweep", "T = -280 °C … 20 °C", "--extrapolate", "--out", "@p.html"), "−273.15 °C"),
        (("--sweep", "fx = 0 … 1 g", "--at", "f = 0.2 g, 0, 0", "--out", "@p.html"), "--at fx"),
        (("--sweep", "T = 0 °C … 9 °C", "--at", "T = 3 °C", "--out", "@p.html"), "--at T"),
        (("--at", ""), "--at"),
        ((), "--at"),
        (("--at", "f = 3 g, 0, 0"), "ax"),
        (("--at", "T = 90 °C"), "90 °C"),
        (("--sweep", "fx = 0 … 1 g"), "--out"),
        (("--sweep", "ax = 0 … 1 g", "--out", "@p.html"), "--sweep"),
        (("--sweep", "fx = 1 g … 1 g", "--out", "@p.html"), "--sweep"),
        (("--sweep", "fx = 0 … 1 g", "--out", "@p.csv"), ".html"),
        (("--points", "@bad.csv", "--out", "@p.csv"), "ax"),
        (("--points", "@bare.csv", "--out", "@p.csv"), "fx"),
        (("--points", "@gap.csv", "--out", "@p.csv"), "row 2"),
        (("--points", "@gap.csv", "--out", "@gap.csv", "--force"), "input"),
        (("--points", "@bad.csv", "--at", "f = 0, 0, 0"), "--points"),
        (("--sweep", "fx = 0 … 1 g", "--at", "f = 0, 0, 0", "--at", "T = 20 °C"), "--at"),
    ],
)
def test_a_mistake_is_one_line_and_leaves_nothing(folder: Path, words: tuple[str, ...], named: str):
    (folder / "bad.csv").write_text("ax[g]\n1\n")
    (folder / "bare.csv").write_text("fx\n1\n")
    (folder / "gap.csv").write_text("fx [g],fy [g]\n1,0\n0.5,\n")
    before = sorted(folder.iterdir())
    full = (word.replace("@", f"{folder}/") for word in words)
    done = run_program("predict", folder / "imu.calibration.json", *full)
    assert (done.status, done.output, done.error.count("\n")) == (2, "", 1)
    assert named in done.error
    assert sorted(folder.iterdir()) == before


def test_no_temperature_is_stated_that_nobody_gave(folder: Path):
    path = folder / "one.calibration.json"
    bare = load(path)
    assert bare.validity is not None
    save(replace(bare, validity=replace(bare.validity, temperature=None)), path)
    words = ("predict", path, "--at", "f = 0.5 g")
    assert "°C" not in run_program(*words).output
    assert json.loads(run_program(*words, "--json").output)["temperature"] == [None]
    (folder / "p.csv").write_text("fx [g],fy [g]\n0.5,0\n")
    done = run_program("predict", path, "--points", folder / "p.csv", "--out", folder / "out.csv")
    assert done.status == 0
    assert "T [" not in (folder / "out.csv").read_text(encoding="utf-8")
    stated = run_program("predict", path, "--at", "f = 0.5 g; T = 40 °C").output
    assert "40.00 °C" in stated
    assert "ranges that the calibration states" in stated


def test_outside_without_an_effect_says_that_u_does_not_grow(folder: Path):
    path = folder / "one.calibration.json"
    one = load(path)
    save(replace(one, verdict=Verdict("consistent", undetectable=())), path)
    done = run_program("predict", path, "--at", "f = 3 g", "--extrapolate")
    assert "U does not grow" in done.output


def test_a_gyro_needs_three_components_of_force(folder: Path):
    gyro = Sensor("fog", axes_along(["z"], "w", "g")).with_coefficients("bias")
    path = save(Calibration(gyro, np.zeros(1), np.eye(1)), folder / "fog.calibration.json")
    done = run_program("predict", path, "--at", "f = 1 g")
    assert (done.status, done.error.count("\n")) == (2, 1)
    assert "fog has 0 axes" in done.error


@pytest.mark.parametrize("place", [".", "other"])
@pytest.mark.parametrize("verb", ["export", "predict"])
def test_no_verb_overwrites_an_input_of_the_calibration(folder: Path, verb: str, place: str):
    recording = folder / "log.csv"
    recording.write_text("t,f\n0,1\n")
    digest = sha256(recording.read_bytes()).hexdigest()
    stated = {"recording": "log.csv", "recording sha256": digest}
    one = replace(load(folder / "one.calibration.json"), provenance=stated)
    path = save(one, folder / place / "log.calibration.json")
    (folder / "points.csv").write_text("fx [g],fy [g]\n0,0\n")
    words = ("--to", "csv") if verb == "export" else ("--points", folder / "points.csv")
    done = run_program(verb, path, *words, "--out", recording, "--force")
    assert (done.status, "input" in done.error) == (2, True)
    assert recording.read_text() == "t,f\n0,1\n"

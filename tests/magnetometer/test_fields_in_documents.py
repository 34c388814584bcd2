"""Magnetometers in noise analyses, the register, certificates and the tables of the report."""

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from tests.magnetometer.nine_axes import OFFSET, D, calibrated, nine_axes
from tests.noise.generator import Truth, draw
from tests.program import run_program

from inercal.calibration.files import save
from inercal.laboratory.certificate.dcc import dsi_unit
from inercal.laboratory.certificate.results import make_results
from inercal.laboratory.store import Register
from inercal.noise import analyse_noise
from inercal.noise.sensor_noise import sensor_noise
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import SI_UNITS, TABLES
from inercal.recordings import Recording
from inercal.report.report_tables import coefficients
from inercal.runfile.noise_data_sheet import read_noise_data_sheet

DATE = "2026-01-02"
NOISE = Truth(32768, 0.1, 20.0, 8.0, 0.3, unit=1e-9)  # nT


def at_rest(seed: int = 2) -> Recording:
    y = draw(NOISE, seed, 3) * 1e9
    names, units = ("mx", "my", "mz"), ("nT",) * 3
    time = NOISE.dt * np.arange(float(NOISE.n))
    return Recording(time, y.T + 4e4, names, units, source="rest.csv", sha256=f"{seed:064d}")


@pytest.mark.slow
def test_noise_of_a_magnetometer_is_found_in_nanotesla(tmp_path: Path):
    analysis = analyse_noise(at_rest(), terms="NBK")
    units = {"N": "nT/√Hz", "B": "nT", "K": "nT/√s"}
    truth = {"N": NOISE.white, "B": NOISE.flicker, "K": NOISE.walk}
    for channel in analysis.channels:
        assert channel.quantity == "magnetometer"
        for symbol, unit in units.items():
            found = channel.coefficient(symbol)
            assert found is not None
            assert found.unit == unit
            assert abs(found.value / found.size - truth[symbol]) < 4 * found.u / found.size
    assert list(sensor_noise(analysis).triads) == ["magnetometer"]
    with Register(str(tmp_path / "register.db"), "A. Tester") as register:
        assert register.enter_noise(analysis, "nine", "2026-01-01") == 1


def test_a_data_sheet_states_the_noise_of_a_magnetometer(tmp_path: Path):
    sheet = tmp_path / "sheet.toml"
    sheet.write_text(
        '[datasheet]\nrate = "100 Hz"\n[datasheet.magnetometer]\nrms = "0.4 µT"\n'
        'bandwidth = "50 Hz"\nbandwidth_kind = "noise"\nrandom_walk = "1 nT/√s"\n',
        encoding="utf-8",
    )
    triad = read_noise_data_sheet(sheet).sensor_noise.triads["magnetometer"]
    assert triad.values["N"][0] == pytest.approx(0.4e-6 / 10)
    assert triad.values["K"][0] == pytest.approx(1e-9)


@pytest.mark.parametrize("kind", QUANTITIES)
def test_every_unit_of_a_table_has_an_si_unit(kind: str):
    assert {one.unit for one in TABLES[kind]} <= set(SI_UNITS)


def test_a_certificate_states_every_coefficient_in_the_unit_of_the_table():
    rows = make_results(calibrated(nine_axes(), D, OFFSET), None, np.inf).rows
    found = {row.name: row for row in rows}
    assert float(found["mx.bias"].value) == pytest.approx(12.0, abs=0.1)
    assert found["mx.bias"].value_si == pytest.approx(12e-6, abs=1e-7)
    assert (found["mx.bias"].si_unit, found["my.scale"].si_unit) == ("T", "1")
    assert dsi_unit("T", "T/K") == r"\kelvin\tothe{-1}\tesla\tothe{2}"
    assert (found["mx.delta_o"].term, found["mx.delta_p"].term) == ("m_P", "−m_O")


def test_the_report_states_d_its_parts_and_the_heading():
    calibration = calibrated(nine_axes(("y", "x", "-z")), D[[1, 0, 2]] * [[1], [1], [-1]], OFFSET)

    class Estimated:
        names: tuple[str, ...] = ("dip", "strength")
        value = np.array([np.radians(65), 50e-6])

    class Outcome:
        estimate = Estimated()

    Outcome.calibration = calibration  # type: ignore[attr-defined]
    groups = coefficients(cast("Any", Outcome()), None)
    assert [len(group.axes) for group in groups] == [3, 3, 3, 4]
    rows = {row.name: row for axis in groups[-1].axes for row in axis}
    assert float(rows["my, x"].value.replace("−", "-")) == pytest.approx(-0.01, abs=1e-4)
    assert float(rows["mz, z"].value.replace("−", "-")) == pytest.approx(-1.05, abs=1e-3)
    turn = [float(rows[f"rotation, {one}"].value.replace("−", "-")) for one in "xyz"]
    np.testing.assert_allclose(turn, [-1.99, -1.12, -1.15], atol=0.06)
    # By hand for the offset alone: u(o)/(B cos δ), which is the least that it can be.
    level = float(rows["heading, 0° tilt"].expanded)
    assert level > 2 * np.degrees(0.09 / (50 * np.cos(np.radians(65))))
    Estimated.names = ("other", "names")
    assert len(coefficients(cast("Any", Outcome()), None)[-1].axes) == 3


@pytest.mark.slow
def test_verbs_read_a_calibration_with_magnetometers(tmp_path: Path):
    first = calibrated(nine_axes(), D, OFFSET)
    later = replace(first, values=first.values + 3 * first.std)
    for name, one in (("first", first), ("later", later)):
        save(one, tmp_path / f"{name}.calibration.json")
    paths = [tmp_path / f"{name}.calibration.json" for name in ("first", "later")]
    shown = run_program("show", paths[0])
    assert shown.status == 0
    compared = run_program("compare", *paths)
    assert compared.status in (0, 1)
    assert all(f"{axis}.bias" in compared.output for axis in ("mx", "my", "mz"))
    register = tmp_path / "register.db"
    page = tmp_path / "history.html"
    for path in paths:
        done = run_program("store", "import", path, "--register", register, "--measured", DATE)
        assert done.status == 0, done.error
    for words in (("show", "nine"), ("history", "nine", "--out", page), ("diff", 1, 2)):
        done = run_program("store", *map(str, words), "--register", register)
        assert (done.status, "Traceback" in done.error) == (0, False), done.error
    assert "mx.bias" in page.read_text(encoding="utf-8")

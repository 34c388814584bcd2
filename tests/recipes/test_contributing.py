"""The recipes of CONTRIBUTING, followed: what is added by them works without another edit.

Those of a method, a kind of bench, a file format and packets are followed elsewhere:
tests/rest_bias_method.py, tests/benches/test_external_kind.py, tests/test_registry.py and
tests/host/packets/test_manual_bytes.py.
"""

import shutil
from dataclasses import replace
from importlib import import_module
from math import radians
from pathlib import Path
from pkgutil import iter_modules

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import inercal.cli
from inercal.benches.kind_definition import KINDS
from inercal.benches.report_data import Panel, Plot, ReportInput, Series
from inercal.cli.app import app
from inercal.host import addresses
from inercal.host.drivers.rotary_table import AxisLimits, AxisState, TableState
from inercal.host.drivers.table_address import DRIVERS, Driver
from inercal.physics.motion import Motion
from inercal.physics.sensors import G0, TABLES, inverse, triad
from inercal.physics.sensors.coefficient_tables import TERMS, Basis, ErrorTerm
from inercal.pipeline import calibrate, simulate_files
from inercal.recordings.io.write import write_recording
from inercal.report.calibration_page import calibration_page
from inercal.runfile import read

EXAMPLE = Path(__file__).parents[2] / "examples" / "ferraris_simulated" / "run.toml"
VERBS = [one.name for one in iter_modules(inercal.cli.__path__) if one.name.endswith("_command")]


def test_a_coefficient_is_one_line_of_the_table(monkeypatch: pytest.MonkeyPatch):
    size = 1e-6 * G0 / G0**4
    added = ErrorTerm(
        "k9", "K₉", "µg/g⁴", size, Basis("fi fi fi fi"), "fourth-order nonlinearity", "nonlinearity"
    )
    monkeypatch.setitem(TABLES, "f", (*TABLES["f"], added))
    monkeypatch.setitem(TERMS, "f", {one.name: one for one in TABLES["f"]})  # as at import
    sensor = triad().with_coefficients("k0", "k9")
    c = np.array([0.0, 50 * size] * 3)
    f = Motion(np.array([[G0, 0.5 * G0, -2 * G0]]))
    reading = sensor.forward(f, c)
    np.testing.assert_allclose((reading - f.f)[0] / (50e-6 * G0), [1.0, 0.5**4, 16.0], rtol=1e-9)
    np.testing.assert_allclose(inverse(sensor, reading, c).f, f.f, rtol=1e-12)
    steps = 1e-3 * size
    moved = (sensor.forward(f, c + steps * np.eye(6)[1]) - reading) / steps
    np.testing.assert_allclose(moved, sensor.design(f, c)[..., 1], rtol=1e-6, atol=1e-9)


@pytest.mark.slow
def test_a_report_figure_is_data_that_the_kind_of_bench_gives(tmp_path: Path):
    def plots(shown: ReportInput) -> tuple[Plot, ...]:
        values = shown.observations.mean[:, 0] / G0
        series = Series(np.arange(values.size, dtype=float), values, "x")
        return (Plot("toy", "Means of x", "Mean of x in g.", "g", (Panel("x", "row", (series,)),)),)

    path = Path(shutil.copy(EXAMPLE, tmp_path))
    run = read(path)
    for name, recording in simulate_files(run, 1).items():
        write_recording(recording, run.file(name))
    outcome = calibrate(run)
    text = calibration_page(replace(outcome, kind=replace(KINDS["hand"], plots=plots)), None)
    assert "Mean of x in g." in text
    assert text.count("<svg") == calibration_page(outcome, None).count("<svg") + 1


class OneAxis:
    """A table of one axis that is where it was sent."""

    axes = ("outer",)
    limits = (AxisLimits(),)
    wrap_period = float("inf")

    def __init__(self, timeout: float):
        self.timeout, self.angle = timeout, 0.0

    def move(self, axis: str, angle: float, rate: float, acceleration: float) -> None:
        self.angle = angle

    def read(self) -> TableState:
        return TableState(0.0, (AxisState(self.angle, 0.0, 0.0, True, False, True, True),))


def test_a_table_driver_is_one_entry_by_the_scheme_of_its_address():
    toy = Driver(lambda _, __, timeout: OneAxis(timeout), "toy://HOST")  # pyright: ignore[reportArgumentType]
    with DRIVERS.with_("toy", toy):
        table = addresses.open_table("toy://somewhere", None, 0.5)
    table.move("outer", radians(90), 1.0, 1.0)
    assert table.read().axes[0].angle == radians(90)


@pytest.mark.parametrize("name", VERBS)
def test_a_verb_is_a_module_with_its_name_and_what_it_runs(name: str):
    module = import_module(f"inercal.cli.{name}")
    assert module.run.__doc__
    verb = name.removesuffix("_command").replace("_", "-")
    shown = CliRunner().invoke(app, [verb, "--help"])
    assert shown.exit_code == 0


def test_a_verb_is_one_line_of_the_program(monkeypatch: pytest.MonkeyPatch):
    def run(run_file: Path = typer.Argument(help="The run file (TOML).")) -> None:
        """Say what the sensor of a run file is called."""
        print(read(run_file).sensor.name)

    monkeypatch.setattr(app, "registered_commands", [*app.registered_commands])
    app.command("toy")(run)
    said = CliRunner().invoke(app, ["toy", str(EXAMPLE)])
    assert said.exit_code == 0
    assert said.stdout.strip() == read(EXAMPLE).sensor.name

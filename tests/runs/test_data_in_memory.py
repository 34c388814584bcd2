"""Calibrations of data in memory, against the same data in a file."""

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest

import inercal
from inercal.basics.errors import InputError
from inercal.pipeline import Outcome, simulate
from inercal.runfile import read

EXAMPLES = Path(__file__).parents[2] / "examples"
POSITIONS = EXAMPLES / "six_position" / "positions.csv"
NAMES = ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a")
SENSOR = {"name": "accelerometer SN 0417", "accelerometer": {"unit": "g"}}
BENCH = {"latitude": "48.1 °", "height": "520 m", "tilt": "0.1 °"}
MEANS: dict[str, Any] = {"kind": "means", "label": "position", "sd": {"accelerometer": "30 µg"}}


def columns() -> dict[str, np.ndarray]:
    readings = np.loadtxt(POSITIONS, delimiter=",", skiprows=2, usecols=(1, 2, 3), encoding="utf-8")
    named = zip(("acc_x", "acc_y", "acc_z"), readings.T, strict=True)
    return {"position": np.array(NAMES), **dict(named)}


def means(data: object, **keys: Any) -> Outcome:
    return inercal.calibrate(
        data, method="six_position", sensor=SENSOR, bench=BENCH, **(MEANS | keys)
    )


@pytest.fixture(scope="module")
def of_file() -> Outcome:
    return inercal.calibrate(EXAMPLES / "six_position" / "run.toml")


def test_columns_in_memory_give_what_the_file_gives(of_file: Outcome) -> None:
    one = means(columns()).calibration
    np.testing.assert_array_equal(one.values, of_file.calibration.values)
    np.testing.assert_array_equal(one.covariance, of_file.calibration.covariance)


def test_a_file_of_data_gives_what_the_run_file_gives(of_file: Outcome) -> None:
    one = means(POSITIONS).calibration
    np.testing.assert_array_equal(one.values, of_file.calibration.values)


def test_an_array_has_numbered_columns(of_file: Outcome) -> None:
    arrow = pytest.importorskip("pyarrow")
    table = arrow.table(columns())
    np.testing.assert_array_equal(means(table).calibration.values, of_file.calibration.values)


@pytest.mark.slow
def test_recording_and_array_give_the_same() -> None:
    run = read(EXAMPLES / "hand_held" / "simulated.toml")
    recording = simulate(run, 1)
    sensor: dict[str, Any] = {
        "accelerometer": {"unit": recording.units[0], "white": "100 µg/√Hz"},
        "gyro": {"unit": recording.units[3], "white": "0.01 °/s/√Hz"},
    }
    bench = {"gravity": "9.81 m/s² ± 0.001 m/s²"}
    ways: list[tuple[object, dict[str, Any]]] = [
        (recording, {"marks": "found"}),
        (
            np.column_stack([recording.time, recording.data]),
            {"time": 1, "accelerometer": (2, 3, 4), "gyro": (5, 6, 7)},
        ),
    ]
    one, other = (
        inercal.calibrate(data, method="multi_position", sensor=sensor, bench=bench, **keys)
        for data, keys in ways
    )
    np.testing.assert_allclose(one.calibration.values, other.calibration.values, rtol=1e-12)
    assert one.calibration.provenance["recording"] == "data.npz"


def test_errors_name_the_call_and_no_temporary_folder() -> None:
    data = columns()
    data["acc_w"] = data.pop("acc_z")
    with pytest.raises(InputError) as caught:
        means(data)
    assert caught.value.names == ("acc_z",)
    assert "/" not in str(caught.value).partition(":")[0]
    with pytest.raises(InputError) as caught:
        means(columns(), label="place")
    assert caught.value.names == ("place",)


@pytest.mark.parametrize("data", [3, [1.0, 2.0], np.zeros(4), None])
def test_other_types_are_refused_with_those_accepted(data: object) -> None:
    with pytest.raises(TypeError, match="DataFrame"):
        means(data)


def test_a_run_file_takes_no_sections() -> None:
    with pytest.raises(TypeError):
        inercal.calibrate(EXAMPLES / "six_position" / "run.toml", sensor=SENSOR)
    with pytest.raises(TypeError):
        inercal.calibrate(columns())


def test_tables_for_people_hold_every_coefficient(of_file: Outcome) -> None:
    one = of_file.calibration
    html, latex = one._repr_html_(), one.to_latex()
    for name in one.sensor.coefficients:
        assert f"<td>{name}</td>" in html
        assert name.replace("_", r"\_") in latex
    assert html.count("<tr>") == len(one.sensor.coefficients) + 1
    assert latex.isascii()
    assert len(repr(one)) < 100
    assert "consistent" in repr(of_file)


def test_dataframe_is_in_the_units_of_the_table(of_file: Outcome) -> None:
    pytest.importorskip("pandas")
    one = of_file.calibration
    frame = one.to_dataframe()
    for name in one.sensor.coefficients:
        si = one.sensor.coefficient(name).si
        assert frame.loc[name, "value"] * si == pytest.approx(one.value(name))
        assert frame.loc[name, "U"] * si == pytest.approx(2 * one.uncertainty(name))
        assert frame.loc[name, "unit"] == one.sensor.coefficient(name).unit


def test_figures_are_drawn_on_axes(of_file: Outcome, tmp_path: Path) -> None:
    matplotlib.use("Agg")
    from matplotlib import pyplot

    axes = inercal.plot_residuals(of_file)
    dots = [line.get_ydata() for line in axes.lines if line.get_marker() != "None"]
    drawn = np.concatenate(dots, axis=None)
    np.testing.assert_allclose(np.sort(drawn), np.sort(of_file.estimate.whitened.ravel()))
    figure, other = pyplot.subplots()
    assert inercal.plot_coverage(of_file, other) is other
    assert sum(np.size(line.get_xdata()) for line in other.lines) == 6
    figure.savefig(tmp_path / "coverage.svg")
    figure.savefig(tmp_path / "coverage.pdf")
    pyplot.close("all")


def test_the_package_lists_its_names() -> None:
    assert set(inercal.__all__) | {"__version__"} <= set(dir(inercal))
    assert inercal.__version__[0].isdigit()


def test_marks_may_be_a_mapping_of_labels_to_samples():
    rng = np.random.default_rng(3)
    faces = {"x_p": (0, 1), "x_a": (0, -1), "y_p": (1, 1), "y_a": (1, -1), "z_p": (2, 1)}
    faces |= {"z_a": (2, -1)}
    f = np.zeros((6, 400, 3))
    for k, (axis, sign) in enumerate(faces.values()):
        f[k, :, axis] = sign
    readings = (f + rng.normal(0, 1e-4, f.shape)).reshape(-1, 3)
    pairs = {label: (400 * k + 20, 400 * k + 380) for k, label in enumerate(faces)}
    named = {label: {"start": start, "end": stop} for label, (start, stop) in pairs.items()}
    found = [
        inercal.calibrate(
            readings,
            method="six_position",
            sensor={"accelerometer": {"unit": "g"}},
            bench={"gravity": "9.81 m/s² ± 0.001 m/s²", "tilt": "0.1 °"},
            rate="100 Hz",
            accelerometer=["1", "2", "3"],
            marks=marks,
        ).calibration
        for marks in (pairs, named)
    ]
    np.testing.assert_array_equal(found[0].values, found[1].values)
    assert abs(found[0].value("ax.k0")) < 2 * found[0].uncertainty("ax.k0")

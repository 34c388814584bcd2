"""A guided measurement with VISA instruments: the worksheet, units, repeated and resumed rows."""

import csv
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import chdtri
from tests.benches.generated_runs import (
    calibrate_run,
    read_off,
    simulate_run,
    state_means,
    write_run,
)
from tests.host.guided_runs import measure
from tests.host.visa_meters import COUNTERS, MEASURE, Meters, measure_inputs

from inercal.pipeline import calibrate
from inercal.pipeline.design.worksheet import run_sheet
from inercal.runfile import read

PAGE = (Path(__file__).parents[2] / "docs" / "how-to" / "measure.md").read_text(encoding="utf-8")
VOLTAGES = (MEASURE / "voltages.txt").read_text(encoding="utf-8").split()


@pytest.fixture
def meters(tmp_path: Path) -> Meters:
    return Meters(tmp_path)


@pytest.fixture
def head(tmp_path: Path) -> Path:
    path = tmp_path / "head.toml"
    path.write_text((MEASURE / "head.toml").read_text(encoding="utf-8"), encoding="utf-8")
    return path


def table(path: Path, name: str = "head.csv") -> tuple[list[str], list[dict[str, str]]]:
    """Return the comments and the rows of a worksheet."""
    lines = path.with_name(name).read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    return [line for line in lines if line.startswith("#")], rows


def test_a_voltmeter_fills_the_worksheet_of_a_dividing_head(meters: Meters, head: Path):
    options = (head, "--readings", "3", "--instrument", meters.voltmeter())
    half = measure_inputs(meters, VOLTAGES[:10], *options)
    assert half.status == 130
    rest = measure_inputs(meters, VOLTAGES[10:], *options)
    assert (rest.status, rest.error) == (0, "")
    comments, rows = table(head)
    assert [float(row["output"]) for row in rows] == pytest.approx(list(map(float, VOLTAGES)))
    # The instrument is named once, although the measurement was continued.
    (comment,) = comments
    assert comment.endswith("EXAMPLE,VOLTMETER 6,MY0001,1.0")
    single = head.with_name("head.readings.csv").read_text(encoding="utf-8").splitlines()
    assert len(single) == 1 + 3 * len(VOLTAGES)
    outcome = calibrate(head)
    assert outcome.verdict.grade == "consistent"
    calibration, truth = outcome.calibration, read(head).truth
    for name, value in zip(calibration.sensor.coefficients, calibration.values, strict=True):
        assert abs(value - truth.get(name, 0.0)) < 3 * calibration.uncertainty(name)


def test_another_instrument_is_named_too(meters: Meters, head: Path):
    options = (head, "--instrument", meters.voltmeter())
    measure_inputs(meters, VOLTAGES[:10], *options)
    meters.name("EXAMPLE,VOLTMETER 6,MY0002,1.0")
    assert measure_inputs(meters, VOLTAGES[10:], *options).status == 0
    serials = [comment.split(",")[2] for comment in table(head)[0]]
    assert serials == ["MY0001", "MY0002"]


def test_three_counters_fill_the_worksheet_of_a_centrifuge(meters: Meters, tmp_path: Path):
    """The output is in kHz, around 35 kHz, and the counters read Hz."""
    run = simulate_run(write_run("centrifuge_norm", tmp_path, "turns = 10"), 1)
    state_means(run, "sheet.csv", labelled=True)
    text = run.path.read_text(encoding="utf-8")
    assert 'unit = "g"' in text
    output = 'unit = "kHz"\nscale = "70 Hz/g"\noffset = 35.0'
    run.path.write_text(text.replace('unit = "g"', output), encoding="utf-8")
    stated = replace(read(run.path), truth=run.truth)
    readings = read_off(stated, np.random.default_rng(2))
    rows = [readings[row.label] for row in run_sheet(stated).rows]
    inputs = [
        {name: f"{1000 * value:.6f}" for name, value in zip(COUNTERS, row, strict=True)}
        for row in rows
    ]
    options = [one for name in COUNTERS for one in ("-i", meters.counter(name=name))]
    done = measure_inputs(meters, inputs, run.path, *options)
    assert (done.error, done.status) == ("", 0)
    comments, written = table(run.path, "sheet.csv")
    assert len(comments) == 3
    measured = [[float(row[name]) for name in ("ax", "ay", "az")] for row in written]
    np.testing.assert_allclose(measured, rows, rtol=0, atol=1e-9)
    _, nees = calibrate_run(stated)
    dof = len(stated.sensor.coefficients)
    assert float(chdtri(dof, 0.9995)) < nees * dof < float(chdtri(dof, 0.0005))


def test_a_voltmeter_reads_an_output_in_millivolts(meters: Meters, head: Path):
    text = head.read_text(encoding="utf-8").replace('unit = "V"', 'unit = "mV"')
    head.write_text(text, encoding="utf-8")
    done = measure_inputs(meters, VOLTAGES, head, "--instrument", meters.voltmeter())
    assert done.status == 0
    values = [float(row["output"]) for row in table(head)[1]]
    assert values == pytest.approx([1000 * float(text) for text in VOLTAGES])
    assert calibrate(head).verdict.grade == "consistent"


@pytest.mark.parametrize("unit", ['unit = "LSB"', 'unit = "g"'])
def test_a_unit_that_does_not_fit_the_sensor_is_refused(meters: Meters, head: Path, unit: str):
    text = head.read_text(encoding="utf-8")
    scale = 'scale = "1.3 LSB/g"' if "LSB" in unit else ""
    text = text.replace('unit = "V"', unit).replace('scale = "1.3 V/g"', scale)
    head.write_text(text, encoding="utf-8")
    done = measure_inputs(meters, VOLTAGES, head, "--instrument", meters.voltmeter())
    assert done.status == 2
    assert not any(row["output"] for row in table(head)[1])
    assert measure_inputs(meters, VOLTAGES, head, "-i", meters.counter()).status == 2


def test_a_failed_reading_is_told_and_repeated(meters: Meters, head: Path):
    """An overload, a reply that is no number, and a lost instrument, each in one row."""

    def inputs() -> Iterator[str]:
        yield "+9.90000000E+37"
        yield "OVLD"
        yield VOLTAGES[0]
        meters.lose()
        yield VOLTAGES[1]
        yield from VOLTAGES[1:]

    options = (head, "--instrument", meters.voltmeter())
    done = measure_inputs(meters, inputs(), *options, typed=True)
    assert done.status == 0
    messages = [line for line in done.output.splitlines() if meters.voltmeter() in line]
    assert len(messages) == 1 + 3  # the name of the instrument, and the failures
    values = [float(row["output"]) for row in table(head)[1]]
    assert values == pytest.approx(list(map(float, VOLTAGES)))
    # Nobody repeats a reading of a program.
    done = measure_inputs(meters, ["9.9E37"], *options, "--force")
    assert done.status == 2


def test_a_query_belongs_into_the_address_of_a_driver(meters: Meters, head: Path):
    done = measure(head, "-i", meters.voltmeter(), "--query", "FETCH?")
    assert (done.status, "--query" in done.error) == (2, True)
    done = measure(head, "-i", "GPIB0::22::INSTR")
    assert (done.status, "visa:GPIB0::22::INSTR" in done.error) == (2, True)
    assert not head.with_name("head.csv").exists()


def test_the_page_shows_what_the_script_prints():
    script = MEASURE / "read_meters.py"
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, check=True, timeout=60
    )
    (printed,) = re.findall(r"```text\n(EXAMPLE.*?)```", PAGE, flags=re.S)
    assert done.stdout == printed

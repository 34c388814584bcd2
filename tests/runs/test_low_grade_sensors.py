"""Sensors as crude as the cheapest are delivered go through every method; mistakes do not."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.refusals import refused
from tests.runs.low_grade_cases import LowGradeCase, case_makers, rate_table_case

from inercal.basics.errors import InputError
from inercal.pipeline import calibrate

# Devices in the quick tests, and in the slow ones, where a run takes its time.
FEW = {"ship_multi_angle, joint": 6, "ship_planar": 6, "six_position, rests found": 6}
FEW |= {"multi_position": 1, "turntable_discrete": 1}
SLOW_ONLY = {"turntable_kalman": 8, "turntable_trajectory": 6}
SOME = {"multi_position": 12, "turntable_discrete": 20, **SLOW_ONLY}


def errors(case: LowGradeCase) -> tuple[float, int]:
    """Return the squared errors over the covariance, and the number of coefficients."""
    made = calibrate(case.path).calibration
    off = made.values - np.array([case.truth.get(n, 0.0) for n in made.sensor.coefficients])
    return float(off @ np.linalg.solve(made.covariance, off)), off.size


def assert_accepted(folder: Path, name: str, devices: range) -> None:
    both = [errors(case_makers()[name](folder, seed)) for seed in devices]
    squares, sizes = np.array(both).T
    nees = squares.sum() / sizes.sum()
    print(f"{name}: NEES {nees:.2f} of {len(devices)}")
    # Benches that state errors which these sessions do not have make it less than one.
    assert 0.3 < nees < 1 + 4 * np.sqrt(2 / sizes.sum())


@pytest.mark.parametrize("name", sorted(set(case_makers()) - set(SLOW_ONLY))[::2])
def test_crude_sensors_are_calibrated(tmp_path: Path, name: str):
    assert_accepted(tmp_path, name, range(FEW.get(name, 2)))


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(case_makers()))
@pytest.mark.parametrize("part", [6, evidence(1)])
def test_many_crude_sensors_are_calibrated(tmp_path: Path, name: str, part: int):
    often = 60 if name.startswith("ship") or "found" in name else 20
    assert_accepted(tmp_path, name, range(SOME.get(name, often) // part))


def swap_columns(text: str, data: str) -> tuple[str, str]:
    return text.replace('["ax", "ay", "az"]', '["ay", "ax", "az"]'), data


def reverse_axis(text: str, data: str) -> tuple[str, str]:
    head, *rows = (line.split(",") for line in data.splitlines())
    k = head.index("ay")
    turned = [[*row[:k], repr(-float(row[k])), *row[k + 1 :]] for row in rows]
    return text, "\n".join(",".join(row) for row in (head, *turned)) + "\n"


def change_to_radians(text: str, data: str) -> tuple[str, str]:
    return text.replace('arm_rate = "rpm"', 'arm_rate = "rpm"\narm_rate_unit = "rad/s"'), data


def scale_down(text: str, data: str) -> tuple[str, str]:
    return text.replace('"250 mm', '"25 mm'), data


def change_unit(text: str, data: str) -> tuple[str, str]:
    return text.replace('unit = "g"', 'unit = "m/s²"'), data


Mistake = Callable[[str, str], tuple[str, str]]


@pytest.mark.parametrize(
    "mistake", [swap_columns, reverse_axis, change_to_radians, scale_down, change_unit]
)
@pytest.mark.parametrize("method", ["ship_planar", "ship_multi_angle"])
def test_mistakes_are_refused_of_crude_sensors_too(tmp_path: Path, mistake: Mistake, method: str):
    estimator = "planar" if method == "ship_planar" else "joint"
    for seed in range(2):
        path = rate_table_case(tmp_path, seed, method, estimator).path
        table = tmp_path / "data.csv"
        before = path.read_text(encoding="utf-8"), table.read_text(encoding="utf-8")
        text, data = mistake(*before)
        assert (text, data) != before
        path.write_text(text, encoding="utf-8")
        table.write_text(data, encoding="utf-8")
        with refused(InputError):
            calibrate(path)

"""Which coefficients are remarked as implausible, and which unit is named as the reason."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from tests.suspects.rate_platform_runs import Array, arguments, table

import inercal
from inercal.calibration.plausible_sizes import bias_remarks, scale_remarks, wrong_unit
from inercal.estimation import Estimate
from inercal.physics.sensors import G0, Axis, Readout, triad


def remarks(unit: str, coefficient: str, size: float, full_scale: float | None = None) -> int:
    axis = Axis(
        "ax", "f", (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), readout=Readout(1.0, 0.0, unit, full_scale)
    )
    sensor = triad("t", "f", "x")
    sensor = SimpleNamespace(
        axes=(axis,), coefficients=(f"ax.{coefficient}",), measures=sensor.measures | {"ax": "f"}
    )
    estimate = cast(Estimate, SimpleNamespace(value=np.array([size])))
    found = [
        *scale_remarks(estimate, cast(Any, sensor)),
        *bias_remarks(estimate, cast(Any, sensor)),
    ]
    return len(found)


@pytest.mark.parametrize(
    ("coefficient", "size", "count"),
    [("k1", 0.3, 1), ("k1", 0.03, 0), ("k0", 3 * G0, 1), ("k0", -3 * G0, 1), ("k0", 0.5 * G0, 0)],
)
def test_large_scale_factors_and_biases_are_remarked_but_not_of_counts(
    coefficient: str, size: float, count: int
):
    assert remarks("SI", coefficient, size) == count
    assert remarks("LSB", coefficient, size) == 0


def test_a_wide_range_allows_a_large_bias():
    assert remarks("SI", "k0", 3 * G0, 200 * G0) == 0
    assert remarks("SI", "k0", 30 * G0, 200 * G0) == 1


@pytest.mark.parametrize(
    ("measures", "unit", "scale", "words"),
    [
        ("f", "g", 9.7, "m/s² stated as g"),
        ("f", "SI", 0.103, "g stated as m/s²"),
        ("f", "g", 1010.0, "mg stated as g"),
        ("f", "SI", 101.5, "mg stated as m/s²"),
        ("w", "SI", 57.0, "°/s stated as rad/s"),
        ("w", "°/s", 995.0, "m°/s stated as °/s"),
        ("f", "g", 16400.0, "counts"),
        ("f", "LSB", 1010.0, ""),
        ("f", "V", 1010.0, ""),
        ("f", "g", 2.5, ""),
    ],
)
def test_the_unit_that_explains_a_scale_factor_is_named(
    measures: Any, unit: str, scale: float, words: str
):
    found = wrong_unit(
        Axis("x", measures, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), readout=Readout(1.0, 0.0, unit)),
        scale,
    )
    assert (words in found) if words else not found


def test_a_gyro_with_an_implausible_bias_and_scale_is_remarked_in_its_verdict():
    def change(y: Array, w: Array, setting: object) -> None:
        y[:] = 1.3 * y + 60.0

    def remarked(found: Any) -> list[str]:
        (lines,) = (one.lines for one in found.explanation if "emark" in one.heading)
        return [one for one in lines if "[sensor.gyro]" in one]

    wrong = inercal.calibrate(table(np.random.default_rng(1), change=change), **arguments())
    assert len(remarked(wrong.verdict)) == 2
    right = inercal.calibrate(table(np.random.default_rng(1)), **arguments())
    assert not any(
        "[sensor.gyro]" in line for one in right.verdict.explanation for line in one.lines
    )

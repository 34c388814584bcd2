"""The stored counts of one to six axes are as required; a sample of devices is worked out again."""

import json

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.evidence import axes
from tests.evidence.stored_runs import page_text
from tests.methods.axis_calibrations import joined

from inercal.methods import METHODS

FOUND = json.loads(axes.DATA.read_text(encoding="utf-8"))
AGAIN = ("six_position", "rates_and_poses", "dual_orthogonal", "noise")
LINES = [(method, number) for method, rows in FOUND["methods"].items() for number in rows]


def test_every_method_that_takes_any_axes_is_counted():
    assert set(FOUND["methods"]) == set(axes.ROWS)
    assert set(axes.ROWS) - {"noise"} <= set(METHODS)
    for method, row in axes.ROWS.items():
        rows = FOUND["methods"][method]
        assert [*map(int, rows)] == [*row.axes]
        assert sum(one["devices"] for one in rows.values()) >= 600


@pytest.mark.parametrize(("method", "number"), LINES)
def test_errors_of_any_number_of_axes_are_as_stated(method: str, number: str):
    one = FOUND["methods"][method][number]
    assert one["devices"] == axes.ROWS[method].batch * len(
        axes.tasks(method, int(number), axes.DEVICES)
    )
    assert axes.within(one), one


def test_the_page_is_that_of_the_counts():
    assert page_text(axes.PAGE) == axes.page(FOUND)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "batches"),
    # A batch of one device needs its eight repetitions for a standard deviation.
    [(name, 2 if axes.ROWS[name].batch > 1 else 8) for name in AGAIN]
    + [evidence(name, 8) for name, row in axes.ROWS.items() if row.batch > 1 or name not in AGAIN],
)
def test_a_sample_of_devices_errs_as_stated_again(method: str, batches: int):
    found = joined(
        [
            axes.batch(task)
            for number in axes.ROWS[method].axes
            for task in axes.tasks(method, number, 25)[:batches]
        ]
    )
    for one, expected in ((found.nees, 1.0), (found.inside, axes.EXPECTED)):
        assert abs(one.mean() - expected) < axes.BAND * one.std(ddof=1) / np.sqrt(len(one))

"""Figures whose sizes are stated: what is written stays inside them and apart."""

import numpy as np
import pytest
from matplotlib.axes import Axes
from tests.base_seeds import chosen, evidence

from inercal.report import drawing

NAMES = (
    ("x_p", "x_a", "y_p"),
    ("r01–r02", "r02–r03", "r03–r04"),
    tuple(f"position {k}" for k in range(38)),
    ("20260131", "level plate, second mounting"),
)


@drawing.style
def drawn(names: tuple[str, ...], values: np.ndarray) -> list[Axes]:
    figure, rows = drawing.panels(1.6, [drawing.label_room(()), drawing.label_room(names)], 2)
    for row, named in zip(rows, (False, True), strict=True):
        for axes in row:
            axes.plot(np.linspace(0, len(names) - 1, values.size), values, label="across 1")
            axes.set_ylabel("standard deviations")
            axes.set_title("rotations")
            drawing.add_legend(axes)
            drawing.name_positions(axes, names, named=named)
    figure.draw_without_rendering()
    return figure.axes


def assert_inside_and_apart(panels: list[Axes]):
    boxes = [axes.get_tightbbox() for axes in panels]
    for k, box in enumerate(boxes):
        figure = panels[k].figure.bbox
        assert box is not None
        assert box.x0 >= figure.x0 - 0.5
        assert box.y0 >= figure.y0 - 0.5
        assert box.x1 <= figure.x1 + 3.0  # legends end a little right of their axes
        assert box.y1 <= figure.y1
    for first, second in ((0, 1), (2, 3)):
        left, right = boxes[first], boxes[second]
        assert left is not None
        assert right is not None
        assert left.x1 <= right.x0 + 3.0


@pytest.mark.parametrize("names", [evidence(NAMES[0]), evidence(NAMES[1]), *NAMES[2:]])
def test_names_of_positions_stay_inside_the_figure(names: tuple[str, ...]):
    assert_inside_and_apart(drawn(names, np.array([-1.0, 1.0])))


SIZES = (3e-7, 4.4e-5, 2.5e-3, 0.25, 2.5, 3.3e4, 9.9e4, 8.4e6, 1e12)


@pytest.mark.parametrize(
    ("size", "around"),
    chosen(
        [
            *((size, 1e4) for size in SIZES),
            *((size, around) for size in SIZES[::8] for around in (0, 1)),
        ],
        [(3e-7, 1e4), (9.9e4, 1e4), (1e12, 1e4), (3e-7, 0), (1e12, 1)],
    ),
)
def test_numbers_of_any_size_fit_beside_the_axes(size: float, around: float):
    values = size * (around + np.linspace(-1, 1, 7))
    assert_inside_and_apart(drawn(NAMES[0], values))


def test_no_more_names_are_written_than_can_be_read():
    lower = drawn(NAMES[2], np.zeros(2))[2]
    assert len(lower.texts) <= 20
    assert lower.texts[0].get_text() == NAMES[2][0]


@drawing.style
def test_the_worst_are_named_where_not_all_can_be():
    _, ((axes,),) = drawing.panels(1.6, [1.0])
    drawing.name_positions(axes, [f"p{k}" for k in range(30)], worst=[7, 11])
    named = {text.get_text() for text in axes.texts}
    assert {"p7", "p11", "p0", "p6", "p8"} <= named
    assert "p9" not in named


@pytest.mark.parametrize(
    "days", [0.01, 0.3, 1, 2, 5, 20, 45, 71, 75, 85, 91, 180, 400, 800, 1000, 9000]
)
def test_dates_stand_along_any_length_of_time(days: float):
    """No warning, which is an error here, and one to six dates: 75 days had none of six."""
    import warnings

    from matplotlib.figure import Figure

    from inercal.report.drawing import date_ticks

    for start in (20_000.0, 20_111.3, 20_240.0):
        axes = Figure().add_subplot()
        locator = date_ticks()
        axes.xaxis.set_major_locator(locator)
        axes.set_xlim(start, start + days)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            count = len(locator())
        assert 1 <= count <= 8

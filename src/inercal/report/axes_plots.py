"""Figures of a calibration on axes of matplotlib, for notebooks, papers, SVG and PDF."""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

import numpy as np
from matplotlib import pyplot
from matplotlib.axes import Axes

from inercal.basics.errors import InputError
from inercal.physics.plan import Rotation, Turn
from inercal.pipeline import Outcome
from inercal.report.drawing import MAX_NAMES, SHAPES
from inercal.report.figures import BAND_LIMIT, residual_tables

_BAND = ("0.5", 0.16)  # grey, on light and on dark


def residual_axes(outcome: Outcome, axes: Axes | None) -> Axes:
    """Draw the residuals by row, in standard deviations, with the band of ±2."""
    axes = pyplot.subplots(layout="constrained")[1] if axes is None else axes
    axes.axhspan(-BAND_LIMIT, BAND_LIMIT, color=_BAND, lw=0, zorder=0)
    axes.axhline(0, color="0.6", lw=0.8, zorder=0)
    names: list[str] = []
    for labels, parts, values in residual_tables(outcome):
        rows = np.arange(len(names), len(names) + len(labels))
        for k, part in enumerate(parts):
            axes.plot(rows, values[:, k], SHAPES[k % len(SHAPES)], ms=4, label=part)
        names += labels
    every = -(-len(names) // MAX_NAMES)
    axes.set_xticks(range(0, len(names), every), names[::every], rotation=90)
    axes.set_ylabel("residual, standard deviations")
    axes.set_title(f"{outcome.calibration.sensor.name}: band of ±2, which holds 95 of 100")
    axes.legend()
    return axes


def coverage_axes(outcome: Outcome, axes: Axes | None) -> Axes:
    """Draw the measured directions of the body by longitude and latitude, degrees."""
    found = outcome.kind.directions(outcome)
    if not found:
        raise InputError("the method states no attitudes: there is no coverage to draw")
    axes = pyplot.subplots(layout="constrained")[1] if axes is None else axes
    turned = np.array([isinstance(one.step, Turn | Rotation) for one in found])
    x, y, z = np.array([one.unit_vector for one in found]).T
    longitude, latitude = np.degrees(np.arctan2(y, x)), np.degrees(np.arcsin(np.clip(z, -1, 1)))
    for chosen, mark, name in ((~turned, "o", "held"), (turned, "^", "axis of a turn")):
        if chosen.any():
            axes.plot(longitude[chosen], latitude[chosen], mark, label=name)
    axes.set(
        xlim=(-185, 185), ylim=(-95, 95), xticks=range(-180, 181, 60), yticks=range(-90, 91, 30)
    )
    axes.set_xlabel("longitude in the case, from x towards y, °")
    axes.set_ylabel("latitude in the case, towards z, °")
    axes.set_title(f"{outcome.calibration.sensor.name}: directions that were up")
    axes.grid(alpha=0.3)
    axes.legend()
    return axes

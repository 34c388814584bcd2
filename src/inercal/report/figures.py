"""Residuals, the bench's departures and the correlations, drawn."""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from collections.abc import Mapping, Sequence

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from inercal.estimate import Estimate
from inercal.pipeline import Outcome
from inercal.report import drawing
from inercal.report.drawing import AXES, BAND, FAINT, INK, MINUS, PAPER, PLUS, SHAPES, X, Y, Z, svg

Array = NDArray[np.float64]
KINDS = {"f": ("Accelerometers", "µg", 9.80665e-6), "w": ("Gyros", "°/h", np.pi / 648_000)}
_BAND = 2.0  # standard deviations
_GROUP_UNITS = {"m/s²": ("mm/s²", 1e-3), "rad/s": ("°/h", np.pi / 648_000), "rad": ("mrad", 1e-3)}
_COMPONENTS = {1: ("norm",), 2: ("across 1", "across 2"), 3: ("x", "y", "z")}
_MARKERS = (*SHAPES, "D", "v", "<", ">")
_FEW = 14  # so many coefficients leave room for numbers in their cells


@drawing.style
def residuals(outcome: Outcome) -> Markup:
    """Return whitened residuals (above) and residuals in units (below), by position and turn."""
    if outcome.estimate.groups:
        return _residuals_by_group(outcome)
    sensor, labels = outcome.calibration.sensor, outcome.observations.labels
    shape = (len(labels), len(sensor.axes))
    whitened = outcome.estimate.whitened.reshape(shape)
    plain = outcome.estimate.residual.reshape(shape)
    kinds = [kind for kind in KINDS if any(axis.measures == kind for axis in sensor.axes)]
    figure = Figure(figsize=(9.0, 4.0), layout="constrained")
    grid = figure.subplots(2, len(kinds), squeeze=False, sharex=True)
    for column, kind in enumerate(kinds):
        members = [k for k, axis in enumerate(sensor.axes) if axis.measures == kind]
        names = [sensor.axes[k].name for k in members]
        title, unit, si = KINDS[kind]
        upper, lower = grid[0, column], grid[1, column]
        _dots(upper, whitened[:, members], names, band=True)
        _dots(lower, plain[:, members] / si, names, band=False)
        drawing.name_positions(upper, labels)
        drawing.name_positions(lower, labels)
        upper.set_title(title)
        upper.set_ylabel("standard deviations")
        lower.set_ylabel(unit)
        upper.legend(loc="lower right", bbox_to_anchor=(1.01, 0.98), ncols=3, borderpad=0)
    return svg(figure, "residuals", "Residuals of each mean reading, by position and turn")


def _residuals_by_group(outcome: Outcome) -> Markup:
    groups = outcome.estimate.groups
    figure = Figure(figsize=(9.0, 1.2 + 1.9 * len(groups)), layout="constrained")
    rows = figure.subplots(len(groups), 2, squeeze=False)
    for (upper, lower), group in zip(rows, groups, strict=True):
        unit, si = _GROUP_UNITS[group.unit]
        parts = _COMPONENTS[group.residual.shape[1]]
        _dots(upper, group.residual / group.sd, parts, band=True)
        _dots(lower, group.residual / si, parts, band=False)
        for axes, words in ((upper, "standard deviations"), (lower, unit)):
            drawing.name_positions(axes, group.labels)
            axes.set_ylabel(words)
        upper.set_title(group.name)
        if len(parts) > 1:
            upper.legend(loc="lower right", bbox_to_anchor=(1.01, 0.98), ncols=3, borderpad=0)
    return svg(figure, "residuals", "Residuals of norms, rates and rotations, by rest")


@drawing.style
def departures(pulls: Mapping[str, Sequence[tuple[str, float]]]) -> Markup:
    """Return what was found about the bench, in standard deviations of what was expected.

    Parameters
    ----------
    pulls : mapping of str to sequence of (str, float)
        By position, turn or "run": names of parameters and how far each lies from its expectation.
    """
    names = list(dict.fromkeys(name for found in pulls.values() for name, _ in found))
    table = np.full((len(pulls), len(names)), np.nan)
    for row, found in enumerate(pulls.values()):
        for name, pull in found:
            table[row, names.index(name)] = pull
    figure = Figure(figsize=(9.0, 2.4), layout="constrained")
    axes = figure.subplots()
    _band(axes, table)
    place = np.full(table.shape, np.nan)
    for row, found in enumerate(pulls.values()):
        across = np.linspace(-0.3, 0.3, len(found)) if len(found) > 1 else np.zeros(1)
        place[row, [names.index(name) for name, _ in found]] = row + across
    families = list(dict.fromkeys(name.rstrip("12") for name in names))
    for k, name in enumerate(names):
        shape = _MARKERS[families.index(name.rstrip("12")) % len(_MARKERS)]
        colour = {"1": X, "2": Y}.get(name[-1], Z)
        axes.plot(place[:, k], table[:, k], shape, ms=4.5, mfc=colour, mec=PAPER, mew=0.4,
                  ls="none", label=name)  # fmt: skip
    drawing.name_positions(axes, list(pulls))
    axes.set_ylabel("standard deviations")
    axes.legend(loc="lower right", bbox_to_anchor=(1.01, 0.99), ncols=len(names), borderpad=0)
    return svg(figure, "departures", "What the fit found about the bench, against what was stated")


def _dots(axes: Axes, values: Array, names: Sequence[str], *, band: bool) -> None:
    if band:
        _band(axes, values)
    else:
        axes.axhline(0, color=FAINT, lw=0.8, zorder=0)
        axes.margins(y=0.15)
    shift = 0.18 * (np.arange(len(names)) - (len(names) - 1) / 2)
    for k, name in enumerate(names):
        axes.plot(np.arange(len(values)) + shift[k], values[:, k], SHAPES[k % 3], ms=4.5,
                  mfc=AXES[k % 3], mec=PAPER, mew=0.4, ls="none", label=name)  # fmt: skip


def _band(axes: Axes, values: Array) -> None:
    """Draw the ±2 band and leave room for it and for the values."""
    reach = 1.25 * max(_BAND * 1.25, float(np.nanmax(np.abs(values), initial=0.0)))
    axes.axhspan(-_BAND, _BAND, color=BAND, lw=0, zorder=0)
    axes.axhline(0, color=FAINT, lw=0.8, zorder=0)
    axes.set_ylim(-reach, reach)


@drawing.style
def correlations(estimate: Estimate) -> Markup:
    """Return the correlation coefficients of the wanted parameters, the lower triangle."""
    names = estimate.wanted
    p = len(names)
    matrix = estimate.select(names).correlation
    size = max(4.6, 0.215 * p)
    figure = Figure(figsize=(size + 0.7, size), layout="constrained")
    axes = figure.subplots()
    cells: list[Rectangle] = []
    colours: list[str] = []
    strengths: list[float] = []
    for row in range(1, p):
        for column in range(row):
            r = float(matrix[row, column])
            cells.append(Rectangle((column - 0.46, row - 0.46), 0.92, 0.92))
            colours.append(PLUS if r > 0 else MINUS)
            strengths.append(min(abs(r), 1.0))
            if p <= _FEW and abs(r) >= 0.05:
                axes.text(column, row, f"{r:.2f}".replace("-", "−").replace("0.", "."),
                          ha="center", va="center", fontsize=6,
                          color=PAPER if abs(r) > 0.6 else INK)  # fmt: skip
    _squares(axes, cells, colours, strengths)
    axes.scatter(range(p), range(p), s=4, c=FAINT)
    axes.set_xticks(range(p), names, rotation=90, fontsize=7)
    axes.set_yticks(range(p), names, fontsize=7)
    axes.set(xlim=(-0.6, p - 0.4), ylim=(p - 0.4, -0.6), aspect="equal")
    axes.tick_params(length=0)
    axes.spines[["left", "bottom"]].set_visible(False)
    owners = [name.partition(".")[0] for name in names]
    for k in range(1, p):
        if owners[k] != owners[k - 1]:
            axes.plot([-0.5, k - 0.5, k - 0.5], [k - 0.5, k - 0.5, p - 0.5], color=FAINT, lw=0.6)
    _key(axes)
    return svg(figure, "correlations", "Correlation coefficients of the coefficients")


def _key(axes: Axes) -> None:
    """Draw the scale of the shades into the empty upper triangle."""
    key = axes.inset_axes((0.62, 0.9, 0.36, 0.035))
    steps = np.linspace(-1, 1, 9)
    cells = [Rectangle((k - 0.46, 0), 0.92, 1) for k in range(steps.size)]
    _squares(key, cells, [PLUS if r > 0 else MINUS for r in steps], np.abs(steps).tolist())
    key.set(xlim=(-0.5, 8.5), ylim=(0, 1), yticks=[])
    key.set_xticks([0, 2, 4, 6, 8], ["−1", "−½", "0", "+½", "+1"])
    key.tick_params(length=0)
    key.spines[["left", "bottom"]].set_visible(False)
    key.set_title("correlation", fontsize=8, color=INK)


def _squares(
    axes: Axes, cells: Sequence[Rectangle], colours: Sequence[str], strengths: Sequence[float]
) -> None:
    """Fill cells; those without strength show the page, light or dark."""
    shades = list(zip(colours, strengths, strict=True))
    axes.add_collection(PatchCollection(cells, facecolors=shades, edgecolors=BAND, linewidths=0.3))

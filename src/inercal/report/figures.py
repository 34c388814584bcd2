"""Draw figures of residuals, bench errors with their stated values, and correlations."""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName
from inercal.estimation import Estimate
from inercal.physics.plan import Rotation, Turn
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors.coefficient_tables import BIAS_UNITS
from inercal.pipeline import Outcome
from inercal.report import drawing

SENSOR_KINDS = {
    kind: (one.sensors.capitalize(), one.bias_unit, BIAS_UNITS[kind][0])
    for kind, one in QUANTITIES.items()
}
# Parts of rows that are not axes, such as "velocity east"
_ROW_KINDS = {
    "attitude": ("Attitude after turns", "″", np.pi / 648_000),
    "velocity": ("Velocity after turns", "mm/s", 1e-3),
}
BAND_LIMIT = 2.0
"""Half-width of the shaded band, in standard deviations."""
_OBSERVATION_NAME = re.compile(
    r"([^\[\]]+)\[([^\[\]]+)\]"
)  # name of an observation: the axis, the row
_GROUP_UNITS = {
    "m/s²": ("mm/s²", 1e-3),
    "m/s": ("mm/s", 1e-3),
    "rad/s": ("°/h", np.pi / 648_000),
    "rad": ("mrad", 1e-3),
    "T": ("µT", 1e-6),
}
_FINE_ANGLE = ("″", np.pi / 648_000)  # for angles below 1 mrad
_COMPONENTS = {1: ("norm",), 2: ("across 1", "across 2"), 3: ("x", "y", "z")}
_LEVEL_AXES = ("east", "north", "up")
_MARKERS = (*drawing.SHAPES, "D", "v", "<", ">")
_MAX_NUMBERED = 14  # largest number of coefficients for which cells have room for numbers


@drawing.style
def residuals(outcome: Outcome) -> Markup:
    """Return a figure of the residuals by position and turn: whitened above, in units below."""
    if outcome.estimate.groups:
        return _group_residual_figure(outcome)
    seen = _residual_table(outcome)
    kinds = list(dict.fromkeys(kind for kind in seen.kinds))
    # Turns are in a separate figure below the figure of the means.
    groups = {"residuals": SENSOR_KINDS, "residuals_of_turns": _ROW_KINDS}
    figures = [
        _residual_figures(seen, shown, name)
        for name, known in groups.items()
        if (shown := [kind for kind in kinds if kind in known])
    ]
    return Markup("").join(figures)


def _residual_figures(seen: "_ResidualTable", kinds: Sequence[str], name: str) -> Markup:
    """Return the figures for some kinds of residuals; several figures have half the width."""
    if len(kinds) == 1:
        return _residual_panels(seen, kinds[0], name, half=False)
    return drawing.halves(
        [_residual_panels(seen, kind, f"{name}_{kind}", half=True) for kind in kinds]
    )


def _residual_panels(seen: "_ResidualTable", kind: str, name: str, *, half: bool) -> Markup:
    """Return the figure for one kind of residuals."""
    at = [k for k, own in enumerate(seen.kinds) if own == kind]
    has = np.flatnonzero((~np.isnan(seen.whitened[:, at])).any(axis=1))
    rows = [seen.rows[k] for k in has.tolist()]
    rooms = [drawing.label_room(()), drawing.label_room(rows)]
    figure, ((upper,), (lower,)) = drawing.panels(1.65, rooms, half=half)
    names = [seen.parts[k].removeprefix(f"{kind} ") for k in at]
    title, unit, si = (SENSOR_KINDS | _ROW_KINDS)[kind]
    whitened = seen.whitened[has][:, at]
    draw_dots(upper, whitened, names, band=True)
    draw_dots(lower, seen.plain[has][:, at] / si, names, band=False)
    drawing.name_positions(upper, rows, named=False)
    drawing.name_positions(lower, rows, worst=rows_beyond_band(whitened))
    upper.set(title=title, ylabel="standard deviations")
    lower.set_ylabel(unit)
    drawing.add_legend(upper)
    return drawing.svg(figure, name, f"Residuals of {title}, by position and turn")


class _ResidualTable(NamedTuple):
    """Residuals as a table, (rows, parts), with NaN where a row has no such part."""

    rows: Sequence[str]
    parts: Sequence[str]
    kinds: Sequence[str]  # kind of each part, such as "f"
    whitened: Array
    plain: Array


def _residual_table(outcome: Outcome) -> _ResidualTable:
    """Arrange the residuals in a table, by their names, such as "ax[z_p]", or by their shape."""
    estimate, sensor = outcome.estimate, outcome.calibration.sensor
    named = [_OBSERVATION_NAME.fullmatch(name) for name in estimate.observations]
    found = [(one[1], one[2]) for one in named if one is not None]
    if len(found) == estimate.whitened.size:
        parts, rows = (list(dict.fromkeys(pair[k] for pair in found)) for k in (0, 1))
        number_of_row, number_of_part = (
            {name: k for k, name in enumerate(one)} for one in (rows, parts)
        )
        at = tuple(np.array([(number_of_row[row], number_of_part[part]) for part, row in found]).T)
        whitened, plain = (np.full((len(rows), len(parts)), np.nan) for _ in range(2))
        whitened[at], plain[at] = estimate.whitened, estimate.residual
    else:
        rows = outcome.observations.labels
        whitened, plain = (x.reshape(len(rows), -1) for x in (estimate.whitened, estimate.residual))
        alone = whitened.shape[1] == 1 < len(sensor.axes)
        parts = ["norm"] if alone else [axis.name for axis in sensor.axes]
    kinds = [sensor.measures.get(part) or _row_kind(part) for part in parts]
    return _ResidualTable(rows, parts, kinds, whitened, plain)


def _row_kind(part: str) -> str:
    """Return the kind of a part that is no axis: "velocity" for "velocity east"; otherwise "f"."""
    word = part.partition(" ")[0]
    return word if word in _ROW_KINDS else "f"


def residual_tables(outcome: Outcome) -> Iterator[tuple[Sequence[str], Sequence[str], Array]]:
    """Yield, for each kind, the labels, the parts and the whitened residuals (rows, parts)."""
    estimate = outcome.estimate
    if estimate.groups:
        for group in estimate.groups:
            parts = _LEVEL_AXES if estimate.courses else _COMPONENTS[group.residual.shape[1]]
            yield (
                group.labels,
                [f"{group.name}, {part}" for part in parts],
                group.residual / group.sd,
            )
        return
    seen = _residual_table(outcome)
    yield seen.rows, seen.parts, seen.whitened


def _group_residual_figure(outcome: Outcome) -> Markup:
    groups = outcome.estimate.groups
    named = [group.labels != below.labels for group, below in pairwise(groups)] + [True]
    rooms = [
        drawing.label_room(group.labels if has else ())
        for group, has in zip(groups, named, strict=True)
    ]
    figure, rows = drawing.panels(1.65, rooms, 2)
    courses = outcome.estimate.courses
    for (left, right), group, has in zip(rows, groups, named, strict=True):
        unit, si = _GROUP_UNITS[group.unit]
        if group.unit == "rad" and np.abs(group.residual).max(initial=0.0) < si:
            unit, si = _FINE_ANGLE
        parts = _LEVEL_AXES if courses else _COMPONENTS[group.residual.shape[1]]
        draw_dots(left, group.residual / group.sd, parts, band=True)
        draw_dots(right, group.residual / si, parts, band=False)
        for axes, words in ((left, "standard deviations"), (right, unit)):
            worst = rows_beyond_band(group.residual / group.sd)
            drawing.name_positions(axes, group.labels, named=has, worst=worst)
            axes.set_ylabel(words)
        left.set_title(group.name)
        if len(parts) > 1:
            drawing.add_legend(right)  # on the left, because the title may be long
    return drawing.svg(figure, "residuals", "Residuals of each kind of observation, by step")


@drawing.style
def departures(pulls: Mapping[str, Sequence[tuple[str, float]]]) -> Markup:
    """Return a figure of the estimated minus stated bench errors, in stated standard deviations.

    Parameters
    ----------
    pulls : mapping of str to sequence of (str, float)
        For each position, each turn and "run": the names of parameters and their deviations from
        the stated values.
    """
    names = list(dict.fromkeys(name for found in pulls.values() for name, _ in found))
    table = np.full((len(pulls), len(names)), np.nan)
    for row, found in enumerate(pulls.values()):
        for name, pull in found:
            table[row, names.index(name)] = pull
    figure, ((axes,),) = drawing.panels(1.8, [drawing.label_room(list(pulls))])
    _draw_band(axes, table)
    place = np.full(table.shape, np.nan)
    for row, found in enumerate(pulls.values()):
        across = np.linspace(-0.3, 0.3, len(found)) if len(found) > 1 else np.zeros(1)
        place[row, [names.index(name) for name, _ in found]] = row + across
    families = list(dict.fromkeys(name.rstrip("12") for name in names))
    for k, name in enumerate(names):
        shape = _MARKERS[families.index(name.rstrip("12")) % len(_MARKERS)]
        colour = {"1": drawing.X, "2": drawing.Y}.get(name[-1], drawing.Z)
        axes.plot(place[:, k], table[:, k], shape, ms=4.5, mfc=colour, mec=drawing.PAPER, mew=0.4,
                  ls="none", label=name)  # fmt: skip
    drawing.name_positions(axes, list(pulls), worst=rows_beyond_band(table))
    axes.set_ylabel("standard deviations")
    drawing.add_legend(axes)
    return drawing.svg(figure, "departures", "Estimated minus stated errors of the bench")


def rows_beyond_band(values: Array) -> list[int]:
    """Return the indices of rows with values outside the band, the largest deviation first."""
    size = np.nanmax(np.abs(values), axis=1, initial=0.0)
    return [k for k in np.argsort(-size, kind="stable").tolist() if size[k] > BAND_LIMIT]


def draw_dots(axes: Axes, values: Array, names: Sequence[str], *, band: bool) -> None:
    """Draw values (rows, parts) by row, with a colour and a shape for each part.

    The ±2 band is optional.
    """
    if band:
        _draw_band(axes, values)
    else:
        axes.axhline(0, color=drawing.FAINT, lw=0.8, zorder=0)
        axes.margins(y=0.15)
    shift = 0.18 * (np.arange(len(names)) - (len(names) - 1) / 2)
    for k, name in enumerate(names):
        axes.plot(np.arange(len(values)) + shift[k], values[:, k], drawing.SHAPES[k % 3],
                  ms=4.5, mfc=drawing.AXES[k % 3], mec=drawing.PAPER, mew=0.4, ls="none",
                  label=name)  # fmt: skip


def _draw_band(axes: Axes, values: Array) -> None:
    """Draw the ±2 band, and choose a scale that shows both the band and the values."""
    reach = 1.25 * max(BAND_LIMIT * 1.25, float(np.nanmax(np.abs(values), initial=0.0)))
    axes.axhspan(-BAND_LIMIT, BAND_LIMIT, color=drawing.BAND, lw=0, zorder=0)
    axes.axhline(0, color=drawing.FAINT, lw=0.8, zorder=0)
    axes.set_ylim(-reach, reach)


@drawing.style
def correlations(estimate: Estimate) -> Markup:
    """Return the figure of the coefficients' correlations, as a lower triangle."""
    names = estimate.wanted
    p = len(names)
    matrix = estimate.select(names).correlation
    size = max(4.6, 0.215 * p)
    margin = 0.15 + drawing.LETTER_WIDTH * max(map(len, names))
    figure = Figure(figsize=(size + margin, size + margin))
    share = size / (size + margin)
    axes = figure.add_axes((1 - share, 1 - share, share, share))
    axes.set(xlim=(-0.6, p - 0.4), ylim=(p - 0.4, -0.6))
    axes.axis("off")
    below = [(column, row) for row in range(p) for column in range(row)]
    strengths = [float(matrix[row, column]) for column, row in below]
    _draw_squares(axes, below, strengths)
    for (column, row), r in zip(below, strengths, strict=True):
        if p <= _MAX_NUMBERED and abs(r) >= 0.05:
            axes.text(column, row, f"{r:.2f}".replace("-", "−").replace("0.", "."),
                      ha="center", va="center", fontsize=6,
                      color=drawing.PAPER if abs(r) > 0.6 else drawing.INK)  # fmt: skip
    axes.plot(range(p), range(p), "o", ms=2, color=drawing.FAINT)
    for k, name in enumerate(names):
        axes.text(k, p - 0.3, name, rotation=90, ha="center", va="top", fontsize=7)
        axes.text(-0.7, k, name, ha="right", va="center", fontsize=7)
    owners = [CoefficientName(name).axis for name in names]
    for k in range(1, p):
        if owners[k] != owners[k - 1]:
            axes.plot(
                [-0.5, k - 0.5, k - 0.5], [k - 0.5, k - 0.5, p - 0.5], color=drawing.FAINT, lw=0.6
            )
    _draw_colour_scale(axes)
    return drawing.svg(figure, "correlations", "Correlation coefficients of the coefficients")


def _draw_colour_scale(axes: Axes) -> None:
    """Draw the colour scale into the empty upper triangle."""
    key = axes.inset_axes((0.62, 0.9, 0.36, 0.035))
    _draw_squares(key, [(k, 0) for k in range(9)], np.linspace(-1, 1, 9).tolist())
    key.set(xlim=(-0.5, 8.5), ylim=(-0.5, 0.5))
    key.axis("off")
    for k, text in zip((0, 2, 4, 6, 8), ("−1", "−½", "0", "+½", "+1"), strict=True):
        key.text(k, -0.7, text, ha="center", va="top")
    key.text(-0.5, 0.8, "correlation")


def _draw_squares(axes: Axes, cells: Sequence[tuple[int, int]], strengths: Sequence[float]) -> None:
    """Colour the cells by their correlations; cells without a correlation stay transparent."""
    square = 0.46 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    shades = [(drawing.PLUS if r > 0 else drawing.MINUS, min(abs(r), 1.0)) for r in strengths]
    corners = [square + cell for cell in cells]
    axes.add_collection(
        PolyCollection(corners, facecolors=shades, edgecolors=drawing.BAND, linewidths=0.3)
    )


_BAND = ("0.5", 0.16)  # grey, on light and dark pages


def _new_axes() -> Axes:
    from matplotlib import pyplot  # imported here because no report needs it

    return pyplot.subplots(layout="constrained")[1]


def residual_axes(outcome: Outcome, axes: Axes | None) -> Axes:
    """Draw the residuals by row, in standard deviations, with a band of ±2."""
    axes = _new_axes() if axes is None else axes
    axes.axhspan(-BAND_LIMIT, BAND_LIMIT, color=_BAND, lw=0, zorder=0)
    axes.axhline(0, color="0.6", lw=0.8, zorder=0)
    names: list[str] = []
    for labels, parts, values in residual_tables(outcome):
        rows = np.arange(len(names), len(names) + len(labels))
        for k, part in enumerate(parts):
            axes.plot(rows, values[:, k], drawing.SHAPES[k % len(drawing.SHAPES)], ms=4, label=part)
        names += labels
    every = -(-len(names) // drawing.MAX_NAMES)
    axes.set_xticks(range(0, len(names), every), names[::every], rotation=90)
    axes.set_ylabel("residual, standard deviations")
    axes.set_title(f"{outcome.calibration.sensor.name}: about 95 % lie within the ±2 band")
    axes.legend()
    return axes


def coverage_axes(outcome: Outcome, axes: Axes | None) -> Axes:
    """Draw the measured directions in the case by longitude and latitude, in degrees."""
    found = outcome.kind.directions(outcome)
    if not found:
        raise InputError("the method does not state attitudes, so there is no coverage to draw")
    axes = _new_axes() if axes is None else axes
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
    axes.set_title(f"{outcome.calibration.sensor.name}: directions that pointed up")
    axes.grid(alpha=0.3)
    axes.legend()
    return axes

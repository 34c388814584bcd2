"""Draw figures as SVG in the colours of the page, such as `var(--ink)`.

matplotlib does not support CSS variables, so figures are first drawn in placeholder colours, which
are only used for this purpose. In the SVG text, the placeholders are then replaced.
"""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

import re
import warnings
from collections.abc import Sequence
from datetime import datetime
from io import StringIO
from typing import Any

import matplotlib
import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure

from inercal.benches.report_data import Plot, Series
from inercal.estimation.uncertainty import COVERAGE

INK, MUTED, FAINT, BAND = "#010a01", "#010a02", "#010a03", "#010a04"
X, Y, Z = "#010a05", "#010a06", "#010a07"
WARN, PLUS, MINUS, PAPER = "#010a08", "#010a09", "#010a0a", "#010a0b"
AXES = (X, Y, Z)
MAX_NAMES = 20
"""Largest number of names along an axis; more would not be readable."""
SHAPES = (
    "o",
    "s",
    "^",
)  # for readers who cannot distinguish the colours, and for black and white prints
_WIDTH = 9.0  # inches, width of a figure on a page
_LEFT, _RIGHT, _ABOVE = 0.75, 0.05, 0.25  # inches, margins around the axes
LETTER_WIDTH = 0.062  # inches, width of a digit at 7 points
_VARIABLES = {
    INK: "ink", MUTED: "muted", FAINT: "faint", BAND: "band", X: "x", Y: "y", Z: "z",
    WARN: "warn", PLUS: "plus", MINUS: "minus", PAPER: "paper",
}  # fmt: skip
_STYLE: dict[Any, Any] = {  # the stubs list the keys as literals
    "font.family": "DejaVu Sans",  # included in matplotlib; the font of the page is narrower
    "font.size": 8.0,
    "svg.fonttype": "none",
    "text.parse_math": False,  # "$" in a label is an ordinary character
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": MUTED,
    "axes.facecolor": "none",
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 8.5,
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # nothing is above the axes, so do not search for it
    "axes.unicode_minus": True,
    "axes.formatter.limits": (-3, 5),  # longer numbers would not fit next to the axes
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "legend.handletextpad": 0.3,
    "legend.columnspacing": 1.2,
    "figure.facecolor": "none",
}
style = matplotlib.rc_context(_STYLE)
"""Decorator for functions that make a figure."""
_X_MARGIN = 12.0  # margin in tick units, at both ends


def svg(figure: Figure, name: str, description: str) -> Markup:
    """Return a figure as an SVG element for a page.

    Parameters
    ----------
    figure : Figure
    name : str
        Prefix of the ids in the SVG; each figure on a page needs a different prefix.
    description : str
        Text that describes the figure for readers who cannot see it.
    """
    text = StringIO()
    unnamed = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    with matplotlib.rc_context({**_STYLE, "svg.hashsalt": name}), warnings.catch_warnings():
        # The font that matplotlib measures with may lack glyphs, but the reader's browser has them.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        figure.savefig(text, format="svg", metadata=unnamed)
    body = text.getvalue()
    body = body[body.index("<svg") :]
    head, _, body = body.partition(">")
    box = re.search(r'viewBox="[^"]*"', head)
    assert box
    body = re.sub(r' d="[^"]*"', _round_coordinates, body)
    body = re.sub(r"\n +", "\n", body)  # indentation takes 5 % of the bytes
    for old, new in (
        ('id="', f'id="{name}-'),
        ("url(#", f"url(#{name}-"),
        ('xlink:href="#', f'href="#{name}-'),
    ):
        body = body.replace(old, new)
    for stand_in, variable in _VARIABLES.items():
        body = body.replace(stand_in, f"var(--{variable})")
    label = Markup.escape(description)
    return Markup(f'<svg {box[0]} role="img" aria-label="{label}">') + Markup(body)


def _round_coordinates(path: re.Match[str]) -> str:
    """Return a path with its coordinates rounded to 1/100 point."""
    return re.sub(r"(\.\d\d)\d+", r"\1", path[0])


def panels(
    height: float, below: Sequence[float], columns: int = 1, *, half: bool = False
) -> tuple[Figure, list[list[Axes]]]:
    """Return a figure and its rows of axes.

    All sizes are stated explicitly, because matplotlib's automatic layouts draw everything two more
    times to measure it.

    Parameters
    ----------
    height : float
        Height of each axes, inches.
    below : sequence of float
        Space below each row, inches.
    columns : int
    half : bool
        Whether the figure has half the width, as `halves` needs.
    """
    width = _WIDTH / 2 if half else _WIDTH
    total = sum(below) + len(below) * (_ABOVE + height)
    each = width / columns
    figure = Figure(figsize=(width, total))
    rows: list[list[Axes]] = []
    foot = total
    for under in below:
        foot -= _ABOVE + height
        size = ((each - _LEFT - _RIGHT) / width, height / total)
        corners = [((_LEFT + k * each) / width, foot / total) for k in range(columns)]
        rows.append([figure.add_axes((*corner, *size)) for corner in corners])
        foot -= under
    return figure, rows


def halves(figures: Sequence[Markup]) -> Markup:
    """Return two half-width figures side by side, or one below the other on a phone."""
    each = Markup("").join(Markup("<div>{}</div>").format(one) for one in figures)
    return Markup('<div class="halves">{}</div>').format(each)


def label_room(labels: Sequence[str]) -> float:
    """Return the space that the names of positions need below the axes, in inches."""
    if not labels:
        return 0.05
    return (
        0.15 + LETTER_WIDTH * 8 / 7 * max(map(len, labels))
        if _needs_upright_labels(labels)
        else 0.25
    )


def _needs_upright_labels(labels: Sequence[str]) -> bool:
    longest = max(map(len, labels), default=0)
    return len(labels) > 10 or longest > 7 or len(labels) * (longest + 1) > 60


def name_positions(
    axes: Axes, labels: Sequence[str], *, named: bool = True, worst: Sequence[int] = ()
) -> None:
    """Write a name under each whole number on the x axis, and draw faint lines between them.

    Parameters
    ----------
    axes : Axes
    labels : sequence of str
        Names of the positions. If there are too many to be readable, some are omitted.
    named : bool
        Whether names are written at all.
    worst : sequence of int
        Indices of the names that must not be omitted, the most important first.
    """
    axes.set(xticks=[], xlim=(-0.6, len(labels) - 0.4))
    between = np.arange(len(labels) - 1) + 0.5
    axes.plot(np.repeat(between, 3), np.tile([0, 1, np.nan], between.size), color=FAINT, lw=0.5,
              zorder=1, transform=axes.get_xaxis_transform())  # fmt: skip
    if not named:
        return
    under, top, centre = axes.get_xaxis_text1_transform(4)
    angle = 90 if _needs_upright_labels(labels) else 0
    every = -(-len(labels) // MAX_NAMES)
    # The names are drawn as texts, because matplotlib's ticks take several times as long.
    chosen: list[int] = []
    for k in (*worst, *range(0, len(labels), every)):
        if all(2 * abs(k - other) >= every for other in chosen if other != k):
            chosen.append(k)
    for k in set(chosen):
        axes.text(k, 0, labels[k], transform=under, rotation=angle, va=top, ha=centre)


def grid(height: float, below: float, count: int, columns: int) -> tuple[Figure, list[Axes]]:
    """Return a figure with some axes in rows; unused places in the last row stay empty."""
    figure, rows = panels(height, [below] * -(-count // columns), columns)
    places = [axes for row in rows for axes in row]
    for axes in places[count:]:
        axes.set_axis_off()
    return figure, places[:count]


def days(time: str) -> float:
    """Convert a time in ISO 8601 to days since 1970, as matplotlib's date axes require."""
    return datetime.fromisoformat(time).timestamp() / 86_400.0


def date_ticks() -> AutoDateLocator:
    """Return a locator for at most six dates along an axis.

    The minimum is two dates. With a minimum of three, matplotlib finds no interval for a range of
    ten weeks or 31 months.
    """
    return AutoDateLocator(minticks=2, maxticks=6)


def name_dates(
    axes: Axes, formats: Sequence[str] | None = None, zero_formats: Sequence[str] | None = None
) -> None:
    """Label an axis in days since 1970 with dates.

    Parameters
    ----------
    axes : Axes
    formats, zero_formats : sequence of str, optional
        Date formats for ticks one year, one month, … apart, and for ticks at the start of the next
        longer unit.
    """
    locator = date_ticks()
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(
        ConciseDateFormatter(locator, formats=formats, zero_formats=zero_formats, show_offset=False)
    )


def add_legend(axes: Axes) -> None:
    """Put the legend in one line above the axes, aligned to the right."""
    axes.legend(loc="lower right", bbox_to_anchor=(1.01, 0.98), ncols=99, borderpad=0)


@style
def draw_plot(plot: Plot) -> Markup | None:
    """Return a plot as SVG, or None if it has no panels."""
    if not plot.panels:
        return None
    several = len(plot.panels) > 1
    figure, (row,) = panels(1.9 if several else 2.0, [0.45], len(plot.panels))
    reach = 1.15 * max(float(np.abs(one.y).max()) for panel in plot.panels for one in panel.series)
    for k, (axes, panel) in enumerate(zip(row, plot.panels, strict=True)):
        axes.axhline(0, color=FAINT, lw=0.8, zorder=0)
        for j, series in enumerate(panel.series):
            _draw_series(axes, series, k if several else j)
        if several:
            axes.set_ylim(-reach, reach)
        if panel.ticks:
            axes.set_xlim(panel.ticks[0] - _X_MARGIN, panel.ticks[-1] + _X_MARGIN)
            axes.set_xticks(panel.ticks)
        axes.set(title=panel.title, xlabel=panel.x)
        add_legend(axes)
    row[0].set_ylabel(plot.y)
    return svg(figure, plot.name, plot.title)


def _draw_series(axes: Axes, series: Series, k: int) -> None:
    if series.hollow:
        axes.plot(series.x, series.y, "o", ms=4.5, mfc="none", mec=MUTED, mew=0.8, ls="none",
                  label=series.name)  # fmt: skip
        return
    error = None if series.sd is None else COVERAGE * series.sd
    axes.errorbar(series.x, series.y, yerr=error, fmt=SHAPES[k % 3], ms=4.5, mfc=AXES[k % 3],
                  mec=PAPER, mew=0.4, ecolor=AXES[k % 3], elinewidth=0.8,
                  label=series.name)  # fmt: skip

"""Figures as SVG whose colours are the page's: `var(--ink)` and the like, light or dark.

matplotlib knows no CSS variables, so figures are drawn in the stand-in colours below, which no
figure uses otherwise, and the SVG's text is changed afterwards.
"""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

import re
import warnings
from collections.abc import Sequence
from io import StringIO
from typing import Any

import matplotlib
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

INK, MUTED, FAINT, BAND = "#010a01", "#010a02", "#010a03", "#010a04"
X, Y, Z = "#010a05", "#010a06", "#010a07"
WARN, PLUS, MINUS, PAPER = "#010a08", "#010a09", "#010a0a", "#010a0b"
AXES = (X, Y, Z)
_NAMES = 20  # under an axis, at most: more cannot be read
SHAPES = ("o", "s", "^")  # for those who do not see the colours, and for black and white prints
_VARIABLES = {
    INK: "ink", MUTED: "muted", FAINT: "faint", BAND: "band", X: "x", Y: "y", Z: "z",
    WARN: "warn", PLUS: "plus", MINUS: "minus", PAPER: "paper",
}  # fmt: skip
_STYLE: dict[Any, Any] = {  # the stubs list the keys as literals
    "font.family": "DejaVu Sans",  # comes with matplotlib; the page's own font is narrower
    "font.size": 8.0,
    "svg.fonttype": "none",
    "text.parse_math": False,  # a label's "$" is a character
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": MUTED,
    "axes.facecolor": "none",
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 8.5,
    "axes.titlelocation": "left",
    "axes.unicode_minus": True,
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
"""Decorator of functions that make a figure."""


def svg(figure: Figure, name: str, description: str) -> Markup:
    """Return the figure as an SVG element for a page.

    Parameters
    ----------
    figure : Figure
    name : str
        Its ids begin with this; another figure of the page has another name.
    description : str
        What it shows, for those who cannot see it.
    """
    text = StringIO()
    unnamed = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    with matplotlib.rc_context({**_STYLE, "svg.hashsalt": name}), warnings.catch_warnings():
        # The reader's browser has glyphs that the font used for measuring lacks.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        figure.savefig(text, format="svg", metadata=unnamed)
    body = text.getvalue()
    body = body[body.index("<svg") :]
    head, _, body = body.partition(">")
    box = re.search(r'viewBox="[^"]*"', head)
    assert box
    body = re.sub(r' d="[^"]*"', _rounded, body)
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


def _rounded(path: re.Match[str]) -> str:
    """Return a path's coordinates to 1/100 point."""
    return re.sub(r"-?\d+\.\d{3,}", lambda number: f"{float(number[0]):.2f}", path[0])


def name_positions(axes: Axes, labels: Sequence[str]) -> None:
    """Put one name under each whole number of the x axis, and a faint line above it."""
    upright = len(labels) > 10 or max(map(len, labels), default=0) > 7
    every = -(-len(labels) // _NAMES)
    axes.set_xticks(range(0, len(labels), every), labels[::every], rotation=90 if upright else 0)
    axes.set_xlim(-0.6, len(labels) - 0.4)
    axes.vlines([k + 0.5 for k in range(len(labels) - 1)], 0, 1, FAINT, lw=0.5,
                transform=axes.get_xaxis_transform())  # fmt: skip

"""HTML page for a study, self-contained and in the style of the report, with SVG charts."""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from collections import Counter

from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from inercal.report import drawing
from inercal.report.drawing import FAINT, INK, PAPER, SHAPES, WARN, X, Y, Z, svg
from inercal.report.templates import render
from inercal.studies.claim import shown
from inercal.studies.study import Chart, Study, StudyPanel

TONES = {"reproduced": "good", "not reproducible": "care", "false": "bad"}
_COLOURS = (X, Y, Z, INK, WARN)
_MARKERS = (*SHAPES, "D", "v")
_MAX_MARKED_POINTS = 20  # largest number of points in a curve with markers
_HEIGHT = 2.4  # inches


def render_study(study: Study) -> str:
    """Return the page of a study as HTML."""
    counted = Counter(finding.verdict for finding in study.findings)
    return render(
        "study.html",
        "inercal.studies",
        study=study,
        counts=[(verdict, counted[verdict], TONES[verdict]) for verdict in TONES],
        tones=TONES,
        draw=draw_chart,
        shown=shown,
    )


@drawing.style
def draw_chart(chart: Chart) -> Markup:
    """Return a chart as an SVG element."""
    height = max(drawing.label_room(panel.names) if panel.names else 0.42 for panel in chart.panels)
    figure, (row,) = drawing.panels(_HEIGHT, [height], len(chart.panels))
    for axes, panel in zip(row, chart.panels, strict=True):
        _plot_panel(axes, panel)
    # Panels that are too narrow for a legend have the same curve names, so one legend is enough.
    same = len({tuple(line.name for line in panel.lines) for panel in chart.panels}) == 1
    for axes in row[-1:] if same else row:
        drawing.add_legend(axes)
    return svg(figure, chart.name, chart.caption)


def _format_power(y: float, _: int | None) -> str:
    return shown(y, 1)


def _plot_panel(axes: Axes, panel: StudyPanel) -> None:
    for k, line in enumerate(panel.lines):
        few = line.x.size <= _MAX_MARKED_POINTS
        axes.plot(line.x, line.y, marker=_MARKERS[k % 5] if few else "", ms=4.5, mec=PAPER, mew=0.4,
                  ls="-" if line.connected else "none", lw=1.1, color=_COLOURS[k % 5],
                  label=line.name)  # fmt: skip
    axes.set_title(panel.title)
    if panel.log_y:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(numticks=8))
        axes.yaxis.set_major_formatter(FuncFormatter(_format_power))
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.yaxis.set_tick_params(which="minor", length=0)
    axes.grid(axis="y", color=FAINT, lw=0.4)
    axes.set_axisbelow(True)
    if panel.names:
        drawing.name_positions(axes, panel.names)
    axes.set_xlabel(panel.x)
    axes.set_ylabel(panel.y)

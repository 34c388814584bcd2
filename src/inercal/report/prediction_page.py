"""HTML page for operating points of which one part varies: raw errors, and U after correction."""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from typing import Any

import numpy as np
from markupsafe import Markup

from inercal.basics.arrays import Array
from inercal.calibration import Calibration
from inercal.calibration.display import title
from inercal.calibration.prediction import Prediction
from inercal.physics.quantities import QUANTITIES
from inercal.pipeline.operating_points import fitting_unit, point_text, quantity_cells, swept_values
from inercal.report import drawing
from inercal.report.drawing import AXES, FAINT, WARN
from inercal.report.report_tables import typeset_minus
from inercal.report.templates import render

_ROWS = 5  # points in the table
_ROUNDING = 1e-9
_LEAST_SHARE = 0.05  # smallest share of the variance that is named
_LINES = ("-", "--", ":")  # for readers who cannot distinguish the colours


def prediction_page(calibration: Calibration, found: Prediction, name: str) -> str:
    """Return the page as HTML; `name` is the quantity that varies, such as the temperature."""
    x, unit = swept_values(name, found)
    varying = np.ptp(found.raw_error, axis=0) > _ROUNDING * np.abs(found.raw_error).max(axis=0)
    kinds = dict.fromkeys(
        one for one, own in zip(found.measures, varying.tolist(), strict=True) if own
    )
    kinds = kinds or found.measures[:1]
    chosen: list[int] = np.linspace(0, x.size - 1, _ROWS).round().astype(int).tolist()
    return render(
        "prediction.html",
        title=title(calibration),
        name=name,
        ends=(point_text(found, 0), point_text(found, -1)),
        figures=[_figure(found, kind, x, f"{name} [{unit}]") for kind in kinds],
        rows=[
            (typeset_minus(f"{x[j]:.5g} {unit}"), bool(found.outside[j]), found.names[k],
             *quantity_cells(found, j, k)[1:], _largest_shares(found, j, k))
            for j in chosen for k, kind in enumerate(found.measures) if kind in kinds
        ],
        outside=sum(map(bool, found.outside)),
        count=x.size,
        extrapolated=", ".join(found.effects),
        remarks=found.remarks,
    )  # fmt: skip


def _largest_shares(found: Prediction, j: int, k: int) -> str:
    causes = {**found.groups, **found.effects}
    shares = sorted(((float(one[j, k]), cause) for cause, one in causes.items()), reverse=True)
    named = (f"{cause} {100 * x:.0f} %" for x, cause in shares[:2] if x >= _LEAST_SHARE)
    return ", ".join(named)


@drawing.style
def _figure(found: Prediction, kind: str, x: Array, label: str) -> Markup:
    """Return two panels for a kind of sensor: raw errors, and bands of ± U after correction."""
    at = [k for k, own in enumerate(found.measures) if own == kind]
    names = [found.names[k] for k in at]
    raw, u = found.raw_error[:, at], found.expanded[:, at]
    sensors = QUANTITIES[kind].sensors
    panels = {
        f"{sensors.capitalize()}: raw error": (raw, raw - u, raw + u),
        f"{sensors.capitalize()}: ± U after correction": (np.zeros_like(u), -u, u),
    }
    outside = np.array([bool(one) for one in found.outside])
    figures: list[Markup] = []
    for heading, (middle, low, high) in panels.items():
        figure, ((axes,),) = drawing.panels(1.9, [0.5], half=True)
        unit, si = fitting_unit(kind, np.maximum(np.abs(low), np.abs(high)))
        for k, name in enumerate(names):
            look: dict[str, Any] = {"color": AXES[k % 3], "ls": _LINES[k % 3], "lw": 1.2}
            for line in (middle,) if middle.any() else (low, high):
                shown = name if line is not low else None
                axes.plot(x, line[:, k] / si, label=shown, **look)
            axes.fill_between(x, low[:, k] / si, high[:, k] / si, color=AXES[k % 3], alpha=0.12,
                              lw=0)  # fmt: skip
        axes.axhline(0, color=FAINT, lw=0.8, zorder=0)
        axes.margins(x=0.04)
        if outside.any():
            axes.fill_between(x, 0, 1, where=outside, transform=axes.get_xaxis_transform(),
                              color=WARN, alpha=0.15, lw=0, zorder=0)  # fmt: skip
        axes.set_title(heading)
        axes.set_xlabel(label)
        axes.set_ylabel(unit)
        drawing.add_legend(axes)
        figures.append(drawing.svg(figure, f"prediction_{kind}_{len(figures)}", heading))
    return drawing.halves(figures)

"""Reports, histories, budgets and worksheets, each a single self-contained HTML page.

Figures are embedded as SVG. Their colours follow the reader's light or dark scheme.
"""

import sys
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from inercal.basics.atomic_files import write_text
from inercal.basics.errors import require_extra, require_installed
from inercal.basics.units import format_value_and_uncertainty
from inercal.estimation.uncertainty import COVERAGE
from inercal.pipeline import Outcome

if TYPE_CHECKING:  # imported when needed: reports need no register, and few need noise
    from matplotlib.axes import Axes

    from inercal.laboratory.store import NoiseEntry, SensorEntry, SensorHistory
    from inercal.laboratory.store.recalibration import Recalibration
    from inercal.pipeline.design.worksheet import Worksheet


def write_report(
    outcome: Outcome,
    path: str | Path,
    truth: Mapping[str, float] | None = None,
    history: "SensorHistory | None" = None,
    *,
    for_customer: bool = False,
) -> Path:
    """Write the report of a calibration and return its path.

    The file is written completely or not at all.

    Parameters
    ----------
    outcome : Outcome
    path : path
    truth : mapping of str to float, optional
        True coefficients of a simulation, in SI, by full name; missing coefficients are zero.
    history : SensorHistory, optional
        Earlier calibrations of the sensor, shown in a separate section.
    for_customer : bool
        Whether to omit run-file keys and recommended next steps.

    Raises
    ------
    InputError
        matplotlib or jinja2 is missing, or the file cannot be written.
    """
    with report_packages():
        _leave_out_documentation()
        from inercal.report.calibration_page import calibration_page
    return write_text(path, calibration_page(outcome, truth, history, for_customer=for_customer))


def plot_residuals(outcome: Outcome, axes: "Axes | None" = None) -> "Axes":
    """Draw the residuals by row, in standard deviations, and return the axes.

    Parameters
    ----------
    outcome : Outcome
    axes : matplotlib.axes.Axes, optional
        Axes to draw on; by default, new axes are created. `axes.figure.savefig` writes SVG or PDF.

    Raises
    ------
    InputError
        matplotlib is missing, or the method has residuals for the whole recording and not for rows.
    """
    with report_packages():
        from inercal.report.figures import residual_axes
    return residual_axes(outcome, axes)


def plot_coverage(outcome: Outcome, axes: "Axes | None" = None) -> "Axes":
    """Draw the measured attitudes as directions in the sensor's case, and return the axes.

    Parameters
    ----------
    outcome : Outcome
    axes : matplotlib.axes.Axes, optional
        Axes to draw on; by default, new axes are created.

    Raises
    ------
    InputError
        matplotlib is missing, or the method does not determine attitudes.
    """
    with report_packages():
        from inercal.report.figures import coverage_axes
    return coverage_axes(outcome, axes)


def write_history(
    history: "SensorHistory",
    path: str | Path,
    next_one: "Recalibration | None" = None,
    noise: Sequence["NoiseEntry"] = (),
) -> Path:
    """Write the page with a sensor's history and return its path.

    The file is written completely or not at all.

    Parameters
    ----------
    history : SensorHistory
    path : path
    next_one : Recalibration, optional
        Date of the next calibration, computed with the user's limits. By default, it is computed
        with the limits of the newest calibration.
    noise : sequence of NoiseEntry
        Noise analyses of the sensor, also shown on the page.

    Raises
    ------
    InputError
        matplotlib or jinja2 is missing, or the file cannot be written.
    """
    return write_text(path, history_page(history, next_one, noise))


def noise_history_page(sensor: "SensorEntry", noise: "Sequence[NoiseEntry]") -> str:
    """Return the HTML page about the noise of a sensor that has no calibrations.

    Raises
    ------
    InputError
        matplotlib or jinja2 is missing.
    """
    with report_packages():
        from inercal.report.sensor_history_page import noise_history_page as noise_page
    return noise_page(sensor, noise)


def history_page(
    history: "SensorHistory",
    next_one: "Recalibration | None" = None,
    noise: Sequence["NoiseEntry"] = (),
) -> str:
    """Return the HTML page with a sensor's history.

    Raises
    ------
    InputError
        matplotlib or jinja2 is missing.
    """
    with report_packages():
        from inercal.report.sensor_history_page import sensor_history_page
    return sensor_history_page(history, next_one, noise)


def write_worksheet(sheet: "Worksheet", path: str | Path, table: str) -> Path:
    """Write the page with a worksheet, and return its path.

    The file is written completely or not at all.

    Parameters
    ----------
    sheet : Worksheet
    path : path
    table : str
        Name of the file into which the user types the readings.

    Raises
    ------
    InputError
        jinja2 is missing, or the file cannot be written.
    """
    with report_packages():
        from inercal.report.templates import render
    known = [
        (one.name, one.meaning, format_value_and_uncertainty(0.0, COVERAGE * one.std / one.size)[1],
         one.unit)
        for one in (*sheet.expected, *sheet.together)
    ]  # fmt: skip
    page = render(
        "worksheet.html",
        run=sheet.run,
        sheet=sheet.sheet,
        columns=[(k, one) for k, one in enumerate(sheet.sheet.headings) if one.on_page],
        table=table,
        known=known,
        together=sheet.together,
        alone=len(sheet.expected),
        groups=[(name, list(rows)) for name, rows in groupby(sheet.sheet.rows, lambda r: r.group)],
        most=_MOST_SHEET_ROWS,
    )
    return write_text(path, page)


_MOST_SHEET_ROWS = 24  # largest group that fits on one sheet of paper
_EXTRA = ("report", "reports need matplotlib and jinja2", ("matplotlib", "jinja2", "markupsafe"))


def report_packages() -> AbstractContextManager[None]:
    """Return a context for the import of a page, which names the extra if a package is missing."""
    return require_extra(*_EXTRA)


def _leave_out_documentation() -> None:
    """In the program, skip matplotlib's texts about artists, a quarter of its import."""
    if "inercal.cli.app" in sys.modules:
        from matplotlib import artist

        artist.kwdoc = lambda artist: ""


def require_report_packages() -> None:
    """Raise an error if the packages for reports are missing, before a long computation starts.

    Raises
    ------
    MissingExtra
        matplotlib or jinja2 is missing.
    """
    require_installed(*_EXTRA)

"""Reports, histories, budgets and worksheets, each a single self-contained HTML page.

Figures are SVG inside the page, whose colours follow the reader's light or dark scheme.
"""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from inercal.basics.atomic_files import write_text
from inercal.basics.errors import require_extra, require_installed
from inercal.basics.units import format_value_and_uncertainty
from inercal.estimation.uncertainty.coverage import COVERAGE
from inercal.physics.sensors import Sensor
from inercal.pipeline import Outcome
from inercal.pipeline.budget import Budget
from inercal.pipeline.design.worksheet import Worksheet
from inercal.pipeline.drafts import Draft
from inercal.pipeline.refused_recording import InspectedRecording
from inercal.recordings import Recording

if TYPE_CHECKING:  # reports do without a register, and most without a noise analysis
    from matplotlib.axes import Axes

    from inercal.laboratory.check_standard import ControlCharts
    from inercal.laboratory.check_standard.bench_charts import BenchCharts
    from inercal.laboratory.store import CalibrationEntry, NoiseEntry, SensorEntry, SensorHistory
    from inercal.laboratory.store.recalibration import Recalibration
    from inercal.noise import NoiseAnalysis
    from inercal.noise.data_sheet import DataSheetNoise


def write_report(
    outcome: Outcome,
    path: str | Path,
    truth: Mapping[str, float] | None = None,
    history: "SensorHistory | None" = None,
    *,
    for_customer: bool = False,
) -> Path:
    """Write the report completely or not at all. Return its path.

    Parameters
    ----------
    outcome : Outcome
    path : path
    truth : mapping of str to float, optional
        True coefficients of a simulation, in SI by full name; missing ones are zero.
    history : SensorHistory, optional
        Calibrations of the sensor, which become a section.
    for_customer : bool
        Whether keys of the run file and what to do next are left out.

    Raises
    ------
    InputError
        matplotlib or jinja2 is missing, or the file cannot be written.
    """
    with _extras():
        from inercal.report.calibration_page import calibration_page
    return write_text(path, calibration_page(outcome, truth, history, for_customer=for_customer))


def plot_residuals(outcome: Outcome, axes: "Axes | None" = None) -> "Axes":
    """Draw the residuals by row, in standard deviations, and return the axes.

    Parameters
    ----------
    outcome : Outcome
    axes : matplotlib.axes.Axes, optional
        New ones by default; `axes.figure.savefig` writes SVG or PDF.

    Raises
    ------
    InputError
        matplotlib is missing, or the method has only residuals of the whole recording.
    """
    with _extras():
        from inercal.report.figures import residual_axes
    return residual_axes(outcome, axes)


def plot_coverage(outcome: Outcome, axes: "Axes | None" = None) -> "Axes":
    """Draw the measured attitudes as directions in the case, and return the axes.

    Parameters
    ----------
    outcome : Outcome
    axes : matplotlib.axes.Axes, optional
        New ones by default.

    Raises
    ------
    InputError
        matplotlib is missing, or the method states no attitudes.
    """
    with _extras():
        from inercal.report.figures import coverage_axes
    return coverage_axes(outcome, axes)


def write_refusal(seen: InspectedRecording, sensor: Sensor, message: str, path: str | Path) -> Path:
    """Write the page of a recording that was refused, completely or not at all. Return its path.

    Parameters
    ----------
    seen : InspectedRecording
    sensor : Sensor
    message : str
        Why it was refused.
    path : path

    Raises
    ------
    InputError
        matplotlib or jinja2 is missing, or the file cannot be written.
    """
    with _extras():
        from inercal.report.recording_pages import refusal_page
    return write_text(path, refusal_page(seen, sensor, message))


def write_history(
    history: "SensorHistory",
    path: str | Path,
    next_one: "Recalibration | None" = None,
    noise: Sequence["NoiseEntry"] = (),
) -> Path:
    """Write the page of a sensor's history completely or not at all. Return its path.

    Parameters
    ----------
    history : SensorHistory
    path : path
    next_one : Recalibration, optional
        When to calibrate next, by the user's limits; by default by those of the newest calibration.
    noise : sequence of NoiseEntry
        Noise analyses of the sensor, which the page shows too.

    Raises
    ------
    InputError
        matplotlib or jinja2 is missing, or the file cannot be written.
    """
    return write_text(path, history_page(history, next_one, noise))


def noise_history_page(sensor: "SensorEntry", noise: "Sequence[NoiseEntry]") -> str:
    """Return the page of the noise of a sensor without calibrations, HTML.

    Raises
    ------
    InputError
        matplotlib or jinja2 is missing.
    """
    with _extras():
        from inercal.report.noise_history_section import noise_history_page as noise_page
    return noise_page(sensor, noise)


def history_page(
    history: "SensorHistory",
    next_one: "Recalibration | None" = None,
    noise: Sequence["NoiseEntry"] = (),
) -> str:
    """Return the page of a sensor's history, HTML.

    Raises
    ------
    InputError
        matplotlib or jinja2 is missing.
    """
    with _extras():
        from inercal.report.sensor_history_page import sensor_history_page
    return sensor_history_page(history, next_one, noise)


def write_control(
    charts: "ControlCharts", path: str | Path, doubtful: "Sequence[CalibrationEntry] | None" = None
) -> Path:
    """Write the page of a check standard's charts, completely or not at all. Return its path.

    Parameters
    ----------
    charts : ControlCharts
    path : path
    doubtful : sequence of CalibrationEntry, optional
        Calibrations of a register while the bench was doubtful.

    Raises
    ------
    InputError
        matplotlib or jinja2 is missing, or the file cannot be written.
    """
    with _extras():
        from inercal.report.control_page import control_page
    return write_text(path, control_page(charts, doubtful))


def write_bench_control(
    charts: "BenchCharts", path: str | Path, doubtful: "Sequence[CalibrationEntry]" = ()
) -> Path:
    """Write the page of a bench's charts, completely or not at all. Return its path.

    Parameters
    ----------
    charts : BenchCharts
    path : path
    doubtful : sequence of CalibrationEntry
        Calibrations of a register while the bench was doubtful.

    Raises
    ------
    InputError
        matplotlib or jinja2 is missing, or the file cannot be written.
    """
    with _extras():
        from inercal.report.control_page import bench_control_page
    return write_text(path, bench_control_page(charts, doubtful))


def write_draft(draft: Draft, path: str | Path) -> Path:
    """Write the page of a drafted run file, completely or not at all. Return its path.

    Parameters
    ----------
    draft : Draft
    path : path

    Raises
    ------
    InputError
        matplotlib or jinja2 is missing, or the file cannot be written.
    """
    with _extras():
        from inercal.report.recording_pages import draft_page
    return write_text(path, draft_page(draft))


def write_noise(
    analysis: "NoiseAnalysis",
    recording: Recording,
    path: str | Path,
    sheet: "DataSheetNoise | None" = None,
) -> Path:
    """Write the page of a noise analysis completely or not at all. Return its path.

    Parameters
    ----------
    analysis : NoiseAnalysis
    recording : Recording
        The analysed recording, in SI.
    path : path
    sheet : DataSheetNoise, optional
        A data sheet to show beside the coefficients.

    Raises
    ------
    InputError
        matplotlib or jinja2 is missing, or the file cannot be written.
    """
    with _extras():
        from inercal.report.noise_page import noise_page
    return write_text(path, noise_page(analysis, recording, sheet))


def write_budget(budget: Budget, path: str | Path, under: str = "") -> Path:
    """Write the page of an error budget completely or not at all. Return its path.

    Parameters
    ----------
    budget : Budget
    path : path
    under : str, optional
        Text under the sensor's name: the method and its estimator.

    Raises
    ------
    InputError
        matplotlib or jinja2 is missing, or the file cannot be written.
    """
    with _extras():
        from inercal.report.budget_page import budget_page
    return write_text(path, budget_page(budget, under))


def write_worksheet(sheet: Worksheet, path: str | Path, table: str) -> Path:
    """Write the page of a worksheet completely or not at all. Return its path.

    Parameters
    ----------
    sheet : Worksheet
    path : path
    table : str
        Name of the file that the readings are typed into.

    Raises
    ------
    InputError
        jinja2 is missing, or the file cannot be written.
    """
    with _extras():
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


_MOST_SHEET_ROWS = 24  # of a group that one sheet of paper holds
_EXTRA = ("report", "reports need matplotlib and jinja2", ("matplotlib", "jinja2", "markupsafe"))


def _extras() -> AbstractContextManager[None]:
    return require_extra(*_EXTRA)


def require_report_packages() -> None:
    """Refuse to start work whose report could not be written.

    Raises
    ------
    MissingExtra
        matplotlib or jinja2 is missing.
    """
    require_installed(*_EXTRA)

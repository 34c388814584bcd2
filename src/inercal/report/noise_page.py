"""HTML page for a noise analysis: the coefficients, then the plots for each channel."""

from pathlib import Path
from typing import Any

from inercal.basics.units import format_duration, format_value_and_uncertainty, si_factor
from inercal.noise.channel_noise import ChannelNoise, NoiseAnalysis
from inercal.noise.data_sheet import DataSheetNoise
from inercal.noise.data_sheet_comparison import HEADS, compare_with_sheet, kind_remarks
from inercal.noise.texts import (
    FILTER_HEADS,
    SHOWN_UNIT,
    channel_remarks,
    coefficient_cells,
    disturbance_text,
    filter_rows,
    movement_text,
)
from inercal.recordings import Recording
from inercal.report.noise_figures import (
    deviation_figure,
    residual_figure,
    spectrogram_figure,
    time_figure,
)
from inercal.report.report_tables import sentence, typeset_minus
from inercal.report.templates import render


def noise_page(
    analysis: NoiseAnalysis, recording: Recording, sheet: DataSheetNoise | None = None
) -> str:
    """Return the page as HTML, with a comparison if a data sheet is given."""
    compared = () if sheet is None else compare_with_sheet(analysis, sheet)
    of_sheet = () if sheet is None else (*sheet.all_remarks, *kind_remarks(compared, sheet))
    good = all(one.goodness.fits for one in analysis.channels)
    disturbed = [
        (one.channel, disturbance_text(found, one.quantity))
        for one in analysis.channels
        for found in one.disturbances
    ]
    name = Path(analysis.source).name
    moved = [movement_text(analysis.movement, name)] if analysis.movement else []
    return render(
        "noise.html",
        name=name or "recording",
        duration=format_duration(analysis.duration),
        rate=f"{1 / analysis.channels[0].dt:.5g}",
        tone="bad" if moved else "good" if good and not disturbed else "care",
        head="The sensor was not at rest"
        if moved
        else f"The terms {'describe the recording' if good else 'miss part of the recording'}; "
        + ("it was disturbed" if disturbed else "no disturbance was found"),
        disturbed=disturbed,
        remarks=(*moved, *analysis.remarks),
        rows=[
            (one.channel, *coefficient_cells(found))
            for one in analysis.channels
            for found in one.coefficients
        ],
        filter_heads=FILTER_HEADS,
        filters=[row for one in analysis.channels for row in filter_rows(one)],
        channels=[_view(one, recording) for one in analysis.channels],
        sheet=None if sheet is None else sheet.name,
        sheet_heads=HEADS,
        sheet_rows=[tuple(map(typeset_minus, one.cells)) for one in compared],
        sheet_remarks=[sentence(one) for one in of_sheet],
    )


def _view(channel: ChannelNoise, recording: Recording) -> dict[str, Any]:
    k = recording.channels.index(channel.channel)
    y = recording.data[:, k] * si_factor(recording.units[k])
    time = recording.time - recording.time[0]
    step = recording.median_step  # larger than Δ if the recording was decimated
    has_lines = channel.lines and step < 1.5 * channel.dt
    return {
        "name": channel.channel,
        "unit": SHOWN_UNIT[channel.quantity],
        "remarks": channel_remarks(channel),
        "deviations": deviation_figure(channel),
        "residuals": residual_figure(channel),
        "time": time_figure(channel, time, y),
        "spectrogram": spectrogram_figure(channel, step, y) if has_lines else None,
        "others": _comparison(channel),
        "method": channel.method,
        "slope_bias": _slope_bias(channel),
    }


def _slope_bias(channel: ChannelNoise) -> str:
    """Describe how values read from slopes differ from the coefficients; empty if they do not."""
    texts: list[str] = []
    for symbol, (value, _) in channel.comparison.get("slopes", {}).items():
        if reported := channel.value(symbol):
            ratio = value / reported - 1
            texts.append(f"{symbol} by {100 * ratio:+.2g} %")
    return typeset_minus(", ".join(texts))


def _comparison(channel: ChannelNoise) -> list[tuple[str, ...]]:
    """Return the rows for the other estimators: method, then N, B and K as value ± u."""
    rows: list[tuple[str, ...]] = []
    for method, found in channel.comparison.items():
        cells: list[str] = []
        for one in channel.coefficients:
            if one.symbol not in found:
                cells.append("")
                continue
            value, u = found[one.symbol]
            shown = format_value_and_uncertainty(value / one.size, u / one.size)
            cells.append(" ± ".join(shown if u < 1e300 else shown[:1]))
        rows.append((method, *cells))
    return [("method", *(f"{one.symbol}, {one.unit}" for one in channel.coefficients)), *rows]

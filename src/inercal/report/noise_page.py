"""HTML page for a noise analysis: the coefficients, then the figures for each channel.

The figures are Allan deviation, spectrum, residuals and time plots.
"""
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false

from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter

from inercal.basics.arrays import Array
from inercal.basics.units import format_duration, format_value_and_uncertainty, si_factor
from inercal.noise import texts as noise_texts
from inercal.noise.channel_noise import ChannelNoise, NoiseAnalysis
from inercal.noise.data_sheet import HEADS, DataSheetNoise, compare_with_sheet, kind_remarks
from inercal.noise.deviations import deviations
from inercal.noise.output_filter import filtered_avar, filtered_model_avar
from inercal.noise.spectrum import block_means
from inercal.noise.terms import TERMS, model_psd
from inercal.recordings import Recording
from inercal.report import drawing
from inercal.report.drawing import BAND, FAINT, INK, MUTED, WARN, X, Y, Z, svg
from inercal.report.report_tables import sentence, typeset_minus
from inercal.report.templates import render

_COLOURS = {"Q": MUTED, "N": X, "B": Y, "K": Z, "G": Y}
_DASHES = {"Q": ":", "N": "--", "B": "-.", "K": (0, (6, 2)), "G": (0, (3, 1, 1, 1))}
_POINTS = 1500  # points in the figure over time
_WINDOWS = 10  # windows of the dynamic Allan deviation
_RATIO_TAUS = 3
_CELLS = 32  # cells of the spectrogram along each axis


def _log_axes(axes: Axes, x: str, y: str) -> None:
    axes.set(xscale="log", yscale="log", xlabel=x, ylabel=y)
    axes.grid(visible=True, which="major", color=FAINT, lw=0.4)
    _plain_decades(axes)


def _plain_decades(axes: Axes) -> None:
    """Label the decades with plain numbers, because text in the SVG cannot show exponents."""
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "log":
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())


@drawing.style
def deviation_figure(channel: ChannelNoise) -> Markup:
    """Return the figure of the Allan deviation and the spectrum, with the fitted terms."""
    figure, ((left,),) = drawing.panels(3.0, [0.5], half=True)
    other, ((right,),) = drawing.panels(3.0, [0.5], half=True)
    unit = noise_texts.SHOWN_UNIT[channel.quantity]
    size = si_factor(unit)
    table, fit = channel.oadev, channel.fit
    tau: Array = np.geomspace(float(table.tau[0]), float(table.tau[-1]), 100)
    left.fill_between(table.tau, table.low / size, table.high / size, color=BAND, lw=0)
    left.plot(table.tau, table.value / size, "o", ms=3, color=INK, label="measured")
    for symbol, variance in fit.as_variances.items():
        avar = filtered_avar(symbol, tau, channel.dt, fit.markov_time, channel.output)
        term = np.sqrt(variance * avar) / size
        left.plot(tau, term, color=_COLOURS[symbol], ls=_DASHES[symbol], lw=0.9, label=symbol)
    total = filtered_model_avar(fit.as_variances, tau, channel.dt, fit.markov_time, channel.output)
    left.plot(tau, np.sqrt(total) / size, color=INK, lw=0.9, label="sum")
    shown = np.concatenate([table.low, table.high]) / size
    left.set_ylim(0.4 * shown.min(), 2 * shown.max())
    _log_axes(left, "averaging time, s", f"Allan deviation, {unit}")
    drawing.add_legend(left)
    _draw_spectrum(right, channel)
    name = channel.channel
    return drawing.halves(
        [
            svg(figure, f"{name}-deviation", "Allan deviation with terms"),
            svg(other, f"{name}-spectrum", "Spectrum with terms"),
        ]
    )


def _draw_spectrum(axes: Axes, channel: ChannelNoise) -> None:
    fit, bins = channel.fit, channel.bins
    unit = TERMS["N"].units[channel.quantity]
    size = si_factor(unit)
    level = np.median(bins.power / fit.model)
    passed, floor = _passed(channel)
    expected = passed * model_psd(
        fit.as_variances, bins.frequency, channel.dt, fit.markov_time
    ) + floor * (1 - passed)
    # The power divided by the model includes the aliases of blocks. Multiplied by the density, this
    # ratio lies on the model line.
    density = np.sqrt(bins.power / fit.model * expected) / size
    axes.plot(bins.frequency, density, ".", ms=2.5, color=MUTED, label="measured")
    order = np.argsort(bins.frequency)
    f = bins.frequency[order]
    for symbol, variance in fit.as_variances.items():
        share = 1.0 if symbol == "Q" else passed[order]
        psd = share * TERMS[symbol].psd(f, channel.dt, fit.markov_time)
        term = np.sqrt(variance * psd) / size
        axes.plot(f, term, color=_COLOURS[symbol], ls=_DASHES[symbol], lw=0.9, label=symbol)
    axes.plot(f, np.sqrt(expected[order]) / size, color=INK, lw=0.9, label="sum")
    if channel.band < np.inf:
        axes.axvspan(channel.band, float(f[-1]), color=(WARN, 0.15), lw=0)
    if channel.output is not None and channel.output.shape.has_cutoff:
        axes.axvline(channel.output.cutoff, color=INK, lw=0.7, ls=":", zorder=0, label="cut-off")
    for line in channel.lines:
        axes.axvline(line.frequency, color=WARN, lw=0.7, zorder=0)
    positive = density[density > 0]
    axes.set_ylim(0.3 * float(np.quantile(positive, 0.02)) * min(level, 1), 2 * positive.max())
    _log_axes(axes, "frequency, Hz", f"√S (two-sided), {unit}")


def _passed(channel: ChannelNoise) -> tuple[Array, float]:
    """Return the fraction of power that the filter passes, and the noise floor after the filter."""
    frequency = channel.bins.frequency
    if channel.output is None:
        return np.ones_like(frequency), 0.0
    return channel.output.power(frequency), channel.output.floor


@drawing.style
def residual_figure(channel: ChannelNoise) -> Markup:
    """Return the figure of the fit's residuals over frequency, in standard deviations."""
    figure, ((axes,),) = drawing.panels(1.5, [0.45])
    found = channel.goodness
    axes.axhspan(-2, 2, color=BAND, lw=0)
    axes.axhline(0, color=FAINT, lw=0.8)
    axes.plot(found.frequency, found.residual, ".", ms=3, color=INK)
    for one in found.decades:
        if not one.fits:
            axes.axvspan(one.low, one.high, color=(WARN, 0.15), lw=0)
    axes.set_xscale("log")
    _plain_decades(axes)
    axes.set(xlabel="frequency, Hz", ylabel="residual, sd")
    return svg(figure, f"{channel.channel}-residual", "Residuals of the spectrum's bins")


@drawing.style
def time_figure(channel: ChannelNoise, time: Array, y: Array) -> Markup:
    """Return a figure of the means over time and of the Allan deviation in ten windows."""
    figure, ((top,), (low,)) = drawing.panels(1.4, [0.1, 0.45])
    unit = noise_texts.SHOWN_UNIT[channel.quantity]
    m = max(1, y.size // _POINTS)
    shown = block_means(y - y.mean(), m) / si_factor(unit)
    top.plot(block_means(time, m), shown, color=INK, lw=0.6)
    top.set_ylabel(f"mean, {unit}")
    _draw_ratios(low, time, y)
    for axes in (top, low):
        axes.set_xlim(float(time[0]), float(time[-1]))
        for one in channel.disturbances:
            end = one.time + (one.seconds if np.isfinite(one.seconds) else 0.0)
            axes.axvspan(one.time, end, color=(WARN, 0.3), lw=0)
            axes.axvline(one.time, color=WARN, lw=0.8)
    top.tick_params(labelbottom=False)
    low.set_xlabel("time from the first sample, s")
    return svg(figure, f"{channel.channel}-time", "Means over time and deviation of ten windows")


def _draw_ratios(axes: Axes, time: Array, y: Array) -> None:
    """Draw each window's Allan deviation relative to the overall one, at three averaging times."""
    size = y.size // _WINDOWS
    longest = int(np.log2(max(size // 8, 1)))
    factors = np.unique(2 ** np.linspace(0, longest, _RATIO_TAUS).astype(int))
    # The interval of the analysis is not used here, because it is the block interval if time stamps
    # jitter.
    dt = float(np.median(np.diff(time)))
    overall = deviations(y, dt, factors=factors.tolist())
    parts = [
        deviations(y[k * size : (k + 1) * size], dt, factors=factors.tolist())
        for k in range(_WINDOWS)
    ]
    middles = [float(time[k * size + size // 2]) for k in range(_WINDOWS)]
    for j, colour in zip(range(factors.size), (X, Y, Z), strict=False):
        ratio = np.array([one.value[j] for one in parts]) / overall.value[j]
        below = np.array([one.value[j] - one.low[j] for one in parts]) / overall.value[j]
        above = np.array([one.high[j] - one.value[j] for one in parts]) / overall.value[j]
        axes.errorbar(middles, ratio, yerr=[below, above], fmt="o-", ms=3, lw=0.7, color=colour,
                      elinewidth=0.6, label=f"{overall.tau[j]:.3g} s")  # fmt: skip
    axes.axhline(1, color=FAINT, lw=0.8)
    axes.set(yscale="log", yticks=[0.5, 1, 2, 5, 10])
    _plain_decades(axes)
    axes.set(ylim=(0.3, max(3.0, axes.get_ylim()[1])), ylabel="deviation ratio")
    drawing.add_legend(axes)


@drawing.style
def spectrogram_figure(channel: ChannelNoise, dt: float, y: Array) -> Markup | None:
    """Return the spectrogram relative to its median, or None if the recording is too short."""
    size = y.size // _CELLS
    if size < 8 * _CELLS:
        return None
    window = np.hanning(size)
    segments = y[: size * _CELLS].reshape(_CELLS, size)
    segments = segments - segments.mean(axis=1, keepdims=True)
    power = np.abs(np.fft.rfft(segments * window, axis=1))[:, 1:] ** 2
    edges = np.arange(_CELLS) * power.shape[1] // _CELLS
    # Each cell shows its maximum, because a spectral line is narrower than a cell.
    cells = np.maximum.reduceat(power, edges, axis=1)
    decibel = 10 * np.log10(cells / np.median(cells))
    shade = np.clip((decibel - 3) / 25, 0, 1)
    figure, ((axes,),) = drawing.panels(1.8, [0.45])
    length, step = size * dt, 1 / (2 * dt) / _CELLS
    for i, j in zip(*np.nonzero(shade > 0.04), strict=True):
        axes.broken_barh([(i * length, length)], (j * step, step),
                         fc=(WARN, round(float(shade[i, j]), 2)), lw=0)  # fmt: skip
    axes.set_xlim(0, _CELLS * length)
    axes.set_ylim(0, _CELLS * step)
    axes.set_xlabel("time from the first sample, s")
    axes.set_ylabel("frequency, Hz")
    return svg(figure, f"{channel.channel}-spectrogram", "Power by time and frequency")


def noise_page(
    analysis: NoiseAnalysis, recording: Recording, sheet: DataSheetNoise | None = None
) -> str:
    """Return the page as HTML, with a comparison if a data sheet is given."""
    compared = () if sheet is None else compare_with_sheet(analysis, sheet)
    of_sheet = () if sheet is None else (*sheet.all_remarks, *kind_remarks(compared, sheet))
    good = all(one.goodness.fits for one in analysis.channels)
    disturbed = [
        (one.channel, noise_texts.disturbance_text(found, one.quantity))
        for one in analysis.channels
        for found in one.disturbances
    ]
    name = Path(analysis.source).name
    moved = [noise_texts.movement_text(analysis.movement, name)] if analysis.movement else []
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
            (one.channel, *noise_texts.coefficient_cells(found))
            for one in analysis.channels
            for found in one.coefficients
        ],
        filter_heads=noise_texts.FILTER_HEADS,
        filters=[row for one in analysis.channels for row in noise_texts.filter_rows(one)],
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
        "unit": noise_texts.SHOWN_UNIT[channel.quantity],
        "remarks": noise_texts.channel_remarks(channel),
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

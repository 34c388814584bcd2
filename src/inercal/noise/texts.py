"""Texts about a noise analysis for the terminal and the page, and the analysis as JSON."""

from math import inf, isinf, sqrt
from typing import Any

from inercal.basics.documents import attributes, record_object
from inercal.basics.units import (
    format_duration,
    format_interval,
    format_number,
    format_quantity,
    format_value_and_uncertainty,
)
from inercal.estimation.uncertainty import COVERAGE
from inercal.noise.channel_noise import ChannelNoise, NoiseAnalysis, NoiseCoefficient
from inercal.noise.coefficients import length_for
from inercal.noise.disturbances import Disturbance
from inercal.noise.output_filter import OutputFilter
from inercal.physics.quantities import QUANTITIES, SensorKind


def analysis_object(analysis: NoiseAnalysis) -> dict[str, Any]:
    """Convert the analysis to plain values in SI; values that are not finite become None."""
    found = {
        **attributes(analysis, "source sha256 duration remarks"),
        "channels": [_channel_object(one) for one in analysis.channels],
    }
    if analysis.movement:
        found["movement"] = analysis.movement
    return record_object(found)


def _filter_object(output: OutputFilter | None) -> dict[str, Any] | None:
    """Return the sensor's own filter as an object; for an average, `cutoff` has no meaning."""
    if output is None:
        return None
    return {
        "shape": output.shape.name,
        "poles": output.shape.poles,
        **attributes(output, "cutoff u"),
        "power_at_half_rate": output.at_half_rate,
        "floor": sqrt(output.floor),
        "known_floor": sqrt(output.known_floor),
        "criterion_gain": output.gain,
    }


def _channel_object(channel: ChannelNoise) -> dict[str, Any]:
    return {
        **attributes(channel, "channel quantity"),
        "samples": channel.n,
        "interval": channel.dt,
        **attributes(channel, "mean method"),
        "model": channel.fit.symbols,
        "coefficients": [
            {
                **attributes(one, "symbol name value u low high"),
                "significant": one.is_significant,
                "likelihood_ratio": one.ratio,
                "limit": one.limit,
                "unit": one.unit,
                "value_in_unit": one.value / one.size,
            }
            for one in channel.coefficients
        ],
        "filter": _filter_object(channel.output),
        "highest_frequency_used": channel.band,
        "refused": channel.refusal,
        "comparison": {
            name: {symbol: {"value": value, "u": u} for symbol, (value, u) in found.items()}
            for name, found in channel.comparison.items()
        },
        "models": [
            {"terms": one.symbols, "aic": one.aic - channel.fit.aic}
            for one in (channel.fit, *channel.selection.rivals)
        ],
        "goodness": attributes(channel.goodness, "fits verdict decades"),
        **attributes(channel, "lines disturbances drift remarks disturbed"),
        "smallest_allan_deviation": {
            "value": float(channel.oadev.value[channel.oadev.lowest]),
            "tau": float(channel.oadev.tau[channel.oadev.lowest]),
        },
        "deviations": {
            kind: attributes(one, "tau value low high edf label")
            for kind, one in channel.deviations.items()
        },
    }


_WANTED = {"N": 0.01, "B": 0.1, "K": 0.2, "G": 0.2}  # target relative u for the recording time
SHOWN_UNIT: dict[SensorKind, str] = {one.sensor: one.bias_unit for one in QUANTITIES.values()}
"""Units in which changes, lines and deviations are stated."""
FILTER_HEADS = ("channel", "shape", "cut-off, Hz", "U (k = 2)", "power at half the rate",
                "gain of the criterion")  # fmt: skip
_HALF_POWER = 0.5  # power at the cut-off
_HALF_RATE = 0.5  # f Δ


def coefficient_cells(one: NoiseCoefficient) -> tuple[str, ...]:
    """Return term, value, U, interval, unit and significance of a coefficient."""
    name = f"{one.symbol}  {one.name}"
    size = one.size
    if one.is_limit:
        limit = format_number(one.high / size, 3)
        return name, f"< {limit}", "", f"0 … {limit}", one.unit, "no"
    if one.symbol == "T" and isinf(one.u):
        sign = ">" if isinf(one.high) else "<"
        return name, f"{sign} {format_number(one.value / size, 3)}", "", "", one.unit, ""
    value, spread = format_value_and_uncertainty(one.value / size, COVERAGE * one.u / size)
    ends = format_interval(one.value / size, one.low / size, one.high / size)
    tested = {True: "yes", False: "no", None: "" if one.symbol == "T" else "open"}[
        one.is_significant
    ]
    return name, value, spread, ends, one.unit, tested


def channel_remarks(channel: ChannelNoise) -> list[str]:
    """Return the verdict on a channel, then its remarks, drift and disturbances, one per line."""
    model = f"the model {' + '.join(channel.fit.symbols)}"
    found = [f"not to be relied on: {channel.disturbed}"] if channel.disturbed else []
    found.append(channel.goodness.verdict.replace("the model", model))
    found += [allan_minimum_text(channel), *filter_remarks(channel)]
    band = channel.goodness.worst_band
    if band is not None and band[0] < channel.band:  # the fit already excludes what is above
        found.append("--skip-band {:.3g}-{:.3g} would exclude this band from the fit".format(*band))
    found += channel.remarks
    shown = SHOWN_UNIT[channel.quantity]
    for one in channel.drift:
        per = {"ramp": "s", "temperature": "K", "temperature rate": "(K/s)"}[one.name]
        size = format_quantity(one.value, COVERAGE * one.u, f"{shown}/{per}")
        found.append(f"drift, {one.name}: {size} (k = 2), included in the fit")
    for line in channel.lines:
        found.append(
            f"line at {format_quantity(line.frequency, 0.0, 'Hz', 4)} with amplitude "
            f"{format_quantity(line.amplitude, 0.0, shown, 3)}, removed before the fit"
        )
    found += [disturbance_text(one, channel.quantity) for one in channel.disturbances]
    if lengths := recording_lengths(channel):
        found.append("recording time needed for " + ", ".join(lengths))
    return found


def allan_minimum_text(channel: ChannelNoise) -> str:
    """State the smallest Allan deviation and its averaging time."""
    one = channel.oadev
    k = one.lowest
    shown = SHOWN_UNIT[channel.quantity]
    size = format_quantity(float(one.value[k]), 0.0, shown, 3)
    return f"smallest Allan deviation: {size} at {format_duration(float(one.tau[k]))}"


def movement_text(movement: str, source: str) -> str:
    """Return a sentence that says that the sensor moved, how it moved, and what to do."""
    return (
        f"{source or 'recording'}: the sensor was not at rest: {movement}. A noise analysis "
        "needs a sensor at rest; give a recording at rest, or only the part of this one that is "
        "at rest"
    )


def recording_lengths(channel: ChannelNoise) -> list[str]:
    """State the recording time that each coefficient needs to reach its target u/value."""
    found: list[str] = []
    for symbol, relative in _WANTED.items():
        if channel.value(symbol):
            seconds = length_for(
                channel.fit.as_variances, channel.dt, symbol, relative, channel.fit.markov_time
            )
            text = "over 30 years" if seconds == inf else format_duration(seconds, 2)
            found.append(f"u({symbol}) = {100 * relative:g} %: {text}")
    return found


def disturbance_text(one: Disturbance, quantity: SensorKind) -> str:
    """Return the kind, time, duration and size of a disturbance, as text."""
    shown = SHOWN_UNIT[quantity]
    size = format_quantity(one.size, 0.0, shown, 3)
    if one.kind == "burst":
        return (
            f"burst at {one.time:.1f} s, {format_duration(one.seconds)} long, "
            f"{format_number(one.size, 2)} times the usual scatter"
        )
    if one.kind == "knock":
        return f"knock at {one.time:.1f} s, {format_duration(one.seconds)} long, of {size}"
    return f"step at {one.time:.1f} s of {size}"


def filter_remarks(channel: ChannelNoise) -> list[str]:
    """Return a remark on the sensor's own filter, or on why N, B and K are not stated."""
    if channel.refusal is not None:
        return [channel.refusal.text]
    if channel.band < inf:
        return [
            "no known filter describes the upper frequencies, so N, B and K come from the band "
            f"below {channel.band:.3g} Hz"
        ]
    if channel.output is None:
        return []
    return [
        f"the cut-off of the sensor's own low-pass filter ({filter_words(channel.output)}) is "
        "below half the sampling rate, so N is the plateau below the cut-off"
    ]


def filter_rows(channel: ChannelNoise) -> list[tuple[str, ...]]:
    """Return the row of a channel in a table with `FILTER_HEADS`; empty if it has no filter."""
    output = channel.output
    if output is None:
        return []
    cutoff = ("", "")
    if output.shape.has_cutoff:
        cutoff = format_value_and_uncertainty(output.cutoff, COVERAGE * output.u)
    return [
        (channel.channel, output.shape.like, *cutoff, f"{output.at_half_rate:.2g}",
         f"{output.gain:.0f}")
    ]  # fmt: skip


def filter_notes(channel: ChannelNoise) -> list[str]:
    """Return a short note on the filter, or on the band that was used, for a written file."""
    if channel.band < inf:
        return [
            f"from frequencies below {channel.band:.3g} Hz, because an unknown filter changes "
            "the spectrum above"
        ]
    if channel.output is None:
        return []
    return [f"behind the sensor's own low-pass filter: {filter_words(channel.output)}"]


def filter_words(output: OutputFilter) -> str:
    """Return shape and cut-off of a filter, with U (k = 2): "one pole, 20.0 ± 0.4 Hz"."""
    if not output.shape.has_cutoff:
        return output.shape.like
    value, spread = format_value_and_uncertainty(output.cutoff, COVERAGE * output.u)
    if output.at_half_rate < _HALF_POWER:
        return f"{output.shape.like}, {value} ± {spread} Hz"
    half = f"the power at half the sampling rate is {output.at_half_rate:.2g}"
    if output.cutoff * output.dt > _HALF_RATE:
        return f"{output.shape.like} above half the sampling rate; {half}"
    return f"{output.shape.like} at {value} ± {spread} Hz; {half}"

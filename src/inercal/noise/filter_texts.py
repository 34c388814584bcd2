"""What is said of a sensor's own low-pass filter."""

from math import inf

from inercal.basics.units import format_value_and_uncertainty
from inercal.estimation.uncertainty.coverage import COVERAGE
from inercal.noise.channel_noise import ChannelNoise
from inercal.noise.output_filter import OutputFilter

FILTER_HEADS = ("channel", "shape", "cut-off, Hz", "U (k = 2)", "power at half the rate",
                "gain of the criterion")  # fmt: skip
_HALF_POWER = 0.5  # at the cut-off
_HALF_RATE = 0.5  # f Δ


def filter_remarks(channel: ChannelNoise) -> list[str]:
    """Return what is known of the sensor's own low-pass filter, or why N, B, K are not stated."""
    if channel.refusal is not None:
        return [channel.refusal.text]
    if channel.band < inf:
        return [
            f"no filter that is known describes the upper frequencies: N, B and K are those of the "
            f"band used, below {channel.band:.3g} Hz"
        ]
    if channel.output is None:
        return []
    return [
        f"the sensor's own low-pass filter ({filter_words(channel.output)}) lies below half the "
        "rate: N is its plateau, that of the samples"
    ]


def filter_rows(channel: ChannelNoise) -> list[tuple[str, ...]]:
    """Return the row of a channel in a table with `FILTER_HEADS`; none without a filter."""
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
    """Return a short note on a filter, or on the band that was used, for a file."""
    if channel.band < inf:
        return [f"from below {channel.band:.3g} Hz: an unknown filter bends the spectrum above"]
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
    half = f"the power at half the rate is {output.at_half_rate:.2g}"
    if output.cutoff * output.dt > _HALF_RATE:
        return f"{output.shape.like} above half the rate; {half}"
    return f"{output.shape.like} at {value} ± {spread} Hz; {half}"

"""A noise analysis in the terminal, and as one object for JSON."""

from typing import Any

from inercal.noise.channel_noise import ChannelNoise, NoiseAnalysis
from inercal.noise.texts import channel_remarks, coefficient_cells


def print_analysis(analysis: NoiseAnalysis) -> None:
    """Print the coefficients of all channels, then the remarks on each."""
    from rich.text import Text

    from inercal.cli.tables import add_row, make_table, number_columns
    from inercal.cli.terminal import terminal

    heads = ("channel", "term", *number_columns(("value", "U (k = 2)", "95 % interval")), "unit",
             "significant")  # fmt: skip
    title = f"{analysis.source or 'recording'}: noise of {analysis.duration:.4g} s"
    table = make_table(*heads, title=title)
    for channel in analysis.channels:
        table.add_section()
        for one in channel.coefficients:
            add_row(table, channel.channel, *coefficient_cells(one))
    console = terminal()
    console.print(table)
    for text in analysis.remarks:
        console.print(Text(text))
    for channel in analysis.channels:
        for text in channel_remarks(channel):
            console.print(Text(f"{channel.channel}: {text}"))


def as_object(analysis: NoiseAnalysis) -> dict[str, Any]:
    """Return the analysis as an object of plain values, SI."""
    return {
        "source": analysis.source,
        "sha256": analysis.sha256,
        "duration": analysis.duration,
        "remarks": list(analysis.remarks),
        "channels": [_channel_object(one) for one in analysis.channels],
    }


def _channel_object(channel: ChannelNoise) -> dict[str, Any]:
    return {
        "channel": channel.channel,
        "quantity": channel.quantity,
        "samples": channel.n,
        "interval": channel.dt,
        "mean": channel.mean,
        "method": channel.method,
        "model": list(channel.fit.symbols),
        "coefficients": [
            {
                "symbol": one.symbol,
                "name": one.name,
                "value": one.value,
                "u": one.u,
                "low": one.low,
                "high": one.high,
                "significant": None if one.symbol == "T" else one.is_significant,
                "likelihood_ratio": one.ratio,
                "limit": one.limit,
                "unit": one.unit,
                "value_in_unit": one.value / one.size,
            }
            for one in channel.coefficients
        ],
        "comparison": {
            name: {symbol: {"value": value, "u": u} for symbol, (value, u) in found.items()}
            for name, found in channel.comparison.items()
        },
        "models": [
            {"terms": list(one.symbols), "aic": one.aic - channel.fit.aic}
            for one in (channel.fit, *channel.selection.rivals)
        ],
        "goodness": {
            "fits": channel.goodness.fits,
            "verdict": channel.goodness.verdict,
            "decades": [vars(one) for one in channel.goodness.decades],
        },
        "lines": [vars(one) for one in channel.lines],
        "disturbances": [vars(one) for one in channel.disturbances],
        "drift": [vars(one) for one in channel.drift],
        "remarks": list(channel.remarks),
        "deviations": {
            kind: {
                "tau": one.tau.tolist(),
                "value": one.value.tolist(),
                "low": one.low.tolist(),
                "high": one.high.tolist(),
                "edf": one.edf.tolist(),
                "label": list(one.label),
            }
            for kind, one in channel.deviations.items()
        },
    }

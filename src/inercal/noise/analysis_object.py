"""Convert a noise analysis to an object for JSON."""

from math import sqrt
from typing import Any

from inercal.basics.documents import record_object
from inercal.noise.channel_noise import ChannelNoise, NoiseAnalysis
from inercal.noise.output_filter import OutputFilter


def analysis_object(analysis: NoiseAnalysis) -> dict[str, Any]:
    """Convert the analysis to plain values in SI; values that are not finite become None."""
    found = {
        "source": analysis.source,
        "sha256": analysis.sha256,
        "duration": analysis.duration,
        "remarks": analysis.remarks,
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
        "cutoff": output.cutoff,
        "u": output.u,
        "power_at_half_rate": output.at_half_rate,
        "floor": sqrt(output.floor),
        "known_floor": sqrt(output.known_floor),
        "criterion_gain": output.gain,
    }


def _channel_object(channel: ChannelNoise) -> dict[str, Any]:
    return {
        "channel": channel.channel,
        "quantity": channel.quantity,
        "samples": channel.n,
        "interval": channel.dt,
        "mean": channel.mean,
        "method": channel.method,
        "model": channel.fit.symbols,
        "coefficients": [
            {
                "symbol": one.symbol,
                "name": one.name,
                "value": one.value,
                "u": one.u,
                "low": one.low,
                "high": one.high,
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
        "goodness": {
            "fits": channel.goodness.fits,
            "verdict": channel.goodness.verdict,
            "decades": channel.goodness.decades,
        },
        "lines": channel.lines,
        "disturbances": channel.disturbances,
        "drift": channel.drift,
        "remarks": channel.remarks,
        "smallest_allan_deviation": {
            "value": float(channel.oadev.value[channel.oadev.lowest]),
            "tau": float(channel.oadev.tau[channel.oadev.lowest]),
        },
        "deviations": {
            kind: {
                name: getattr(one, name) for name in ("tau", "value", "low", "high", "edf", "label")
            }
            for kind, one in channel.deviations.items()
        },
    }

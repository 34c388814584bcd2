"""The noise of a sensor as states of a filter with steps of Δ: Q of each state, as YAML.

A random walk of the bias has q = K² Δ; a Gauss–Markov state φ = e^(−Δ/T) and q = σ² (1 − φ²).
Flicker is a chain of such states (`flicker_states`). White noise N has no state: N² Δ is the
variance of the angle, or velocity, that it adds in a step.
"""

from math import ceil, exp, log10

import numpy as np

from inercal.errors import InputError
from inercal.noise.channel_noise import SI_UNIT, ChannelNoise, NoiseAnalysis, Quantity
from inercal.noise.flicker_states import flicker_states

_SHORTEST = 1.0  # s, of the averaging times of a chain; of slow sensors ten samples


def filter_text(analysis: NoiseAnalysis, horizon: float) -> str:
    """Return the states of a filter that holds the noise, SI; an axis triad has one value.

    Parameters
    ----------
    analysis : NoiseAnalysis
    horizon : float
        s; averaging times of the chain end with it, or with half of a longer recording.

    Raises
    ------
    InputError
        The analysis has no axes.
    """
    lines = [f"# inercal noise: states of a filter, SI, of {analysis.source or 'a recording'}"]
    quantities: tuple[Quantity, ...] = ("accelerometer", "gyro")
    longest = max(horizon, analysis.duration / 2)
    for quantity in quantities:
        axes = analysis.of(quantity)
        if axes:
            lines += [f"{quantity}:", *_triad_lines(axes, SI_UNIT[quantity], longest)]
    if len(lines) == 1:
        raise InputError("the analysis has no axes: nothing to write for a filter")
    return "\n".join([*lines, ""])


def _rms(axes: tuple[ChannelNoise, ...], symbol: str) -> float:
    return float(np.sqrt(np.mean([one.value(symbol) ** 2 for one in axes])))


def _triad_lines(axes: tuple[ChannelNoise, ...], unit: str, longest: float) -> list[str]:
    dt = axes[0].dt
    white, flicker, walk, markov = (_rms(axes, one) for one in "NBKG")
    lines = [
        f"  step: {dt:.9g}  # s",
        f"  white_variance: {white**2 * dt:.6e}  # N² Δ, ({unit})² s²",
        f"  walk_variance: {walk**2 * dt:.6e}  # K² Δ, ({unit})²",
    ]
    states: list[tuple[str, float, float]] = []
    if markov:
        times = [one.value("T") for one in axes if one.value("G")]
        states.append(("Gauss–Markov", float(np.exp(np.mean(np.log(times)))), markov**2))
    if flicker:
        shortest = max(_SHORTEST, 10 * dt)
        decades = max(ceil(log10(longest / shortest) - 1e-9), 2)
        chain = flicker_states(shortest, shortest * 10.0**decades, decades + 1)
        lines.append(
            f"  # flicker of B = {flicker:.6e} {unit}: Allan deviation within "
            f"{100 * chain.misfit:.2g} % from {shortest:g} to {shortest * 10.0**decades:g} s"
        )
        states += [
            ("flicker", float(time), flicker**2 * float(variance))
            for time, variance in zip(chain.times, chain.variances, strict=True)
        ]
    lines.append("  states:" if states else "  states: []")
    for of, time, variance in states:
        phi = exp(-dt / time)
        lines.append(
            f"    - {{of: {of}, time: {time:.6g}, variance: {variance:.6e}, phi: {phi:.12g}, "
            f"q: {-variance * np.expm1(-2 * dt / time):.6e}}}"
        )
    return lines

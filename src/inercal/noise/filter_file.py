"""The noise of a sensor as states of a filter with steps of Δ: Q of each state, as YAML.

A random walk of the bias has q = K² Δ; a Gauss–Markov state φ = e^(−Δ/T) and q = σ² (1 − φ²).
Flicker is a chain of such states (`flicker_states`). White noise N has no state: N² Δ is the
variance of the angle, or velocity, that it adds in a step.
"""

from math import ceil, exp, log10

import numpy as np

from inercal.basics.errors import InputError
from inercal.noise.channel_noise import SI_UNIT
from inercal.noise.flicker_states import flicker_states
from inercal.noise.noise_files import require_rate
from inercal.noise.sensor_noise import SensorNoise, TriadNoise, root_mean_of_squares

_SHORTEST = 1.0  # s, of the averaging times of a chain; of slow sensors ten samples


def filter_text(noise: SensorNoise, horizon: float) -> str:
    """Return the states of a filter that holds the noise, SI; an axis triad has one value.

    Parameters
    ----------
    noise : SensorNoise
    horizon : float
        s; averaging times of the chain end with it, or with half of a longer recording.

    Raises
    ------
    InputError
        There are no axes, or a data sheet states no sampling rate.
    """
    lines = [f"# inercal noise: states of a filter, SI, of {noise.source}"]
    longest = max(horizon, noise.duration / 2)
    for quantity, triad in noise.triads.items():
        lines += [f"{quantity}:", *_triad_lines(triad, SI_UNIT[quantity], longest)]
    if len(lines) == 1:
        raise InputError("the analysis has no axes: nothing to write for a filter")
    return "\n".join([*lines, ""])


def _limited(triad: TriadNoise) -> str:
    return ": upper limit (95 %)" if "K" in triad.limits else ""


def _triad_lines(triad: TriadNoise, unit: str, longest: float) -> list[str]:
    dt = 1 / require_rate(triad)
    white, flicker, walk, markov = (
        root_mean_of_squares([one.get(symbol, 0.0) for one in triad.axes]) for symbol in "NBKG"
    )
    lines = [
        f"  step: {dt:.9g}  # s",
        f"  white_variance: {white**2 * dt:.6e}  # N² Δ, ({unit})² s²"
        if white
        else "  # white_variance: no white noise is stated",
        f"  walk_variance: {walk**2 * dt:.6e}  # K² Δ, ({unit})²{_limited(triad)}"
        if walk
        else "  # walk_variance: no random walk is stated",
    ]
    states: list[tuple[str, float, float]] = []
    if markov:
        times = [one["T"] for one in triad.axes if one.get("G")]
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

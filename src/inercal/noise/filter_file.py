"""Write sensor noise as states of a navigation filter with steps of Δ, as YAML.

The process noise q of a bias random walk is K² Δ in one step. A Gauss–Markov state has φ = e^(−Δ/T)
and q = σ² (1 − φ²). A sum of such states approximates flicker (`flicker_states`). White noise N has
no state; it adds the variance N² Δ to the angle or velocity in one step.

Flicker with B = 1 has the Allan variance 2 ln 2/π. Between two averaging times, the Allan variance
of the processes with time constants T_k and variances v_k approximates this value. The T_k are
evenly spaced in ln T. T_k and v_k ≥ 0 minimise the largest error of the Allan deviation.
"""

from dataclasses import dataclass
from math import ceil, exp, log10

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.noise.channel_noise import SI_UNIT
from inercal.noise.numerics import nonnegative_least_squares
from inercal.noise.sensor_noise import SensorNoise, TriadNoise, require_rate, root_mean_of_squares
from inercal.noise.terms import FLICKER_FLOOR, TERMS

_POINTS = 24  # averaging times per decade
_ENDS = np.geomspace(0.2, 1.6, 19)  # tried ratios of T to the averaging time, at each end
_ROUNDS = 6  # number of reweightings that make the errors even
_CONTINUOUS = 1e-6  # Δ for the continuous-time variance, as a fraction of averaging times
_SHORTEST = 1.0  # s, shortest averaging time; for slow sensors, it is ten samples


@dataclass(frozen=True, eq=False)
class FlickerStates:
    """Gauss–Markov processes whose sum approximates flicker with B = 1.

    Parameters
    ----------
    times : (k,) array
        Time constants T, s.
    variances : (k,) array
    misfit : float
        Largest relative error of the Allan deviation between the two averaging times.
    """

    times: Array
    variances: Array
    misfit: float


def flicker_states(shortest: float, longest: float, states: int) -> FlickerStates:
    """Return processes that approximate flicker for averaging times between two limits, s.

    Parameters
    ----------
    shortest, longest : float
    states : int
        Number of states, at least 2.
    """
    tau: Array = np.geomspace(
        shortest, longest, int(_POINTS * np.log10(longest / shortest)) + 2, dtype=np.float64
    )
    best: FlickerStates | None = None
    for low in _ENDS:
        for high in _ENDS:
            times: Array = np.geomspace(float(low) * shortest, float(high) * longest, states)
            found = _chain(tau, times)
            if best is None or found.misfit < best.misfit:
                best = found
    assert best is not None
    return best


def _chain(tau: Array, times: Array) -> FlickerStates:
    avar = TERMS["G"].avar
    columns = np.stack([avar(tau, _CONTINUOUS * tau[0], float(one)) for one in times], 1)
    columns = columns / FLICKER_FLOOR
    weight, variances, misfit = np.ones(tau.size), np.zeros(times.size), np.inf
    for _ in range(_ROUNDS):
        trial = nonnegative_least_squares(columns * weight[:, None], weight)
        error = np.abs(np.sqrt(columns @ trial) - 1)
        if error.max() < misfit:
            variances, misfit = trial, float(error.max())
        # Lawson's weights converge to the smallest maximum error.
        weight = weight * np.sqrt(error / error.max() + 1e-3)
    return FlickerStates(times, variances, misfit)


def filter_text(noise: SensorNoise, horizon: float) -> str:
    """Return a text with filter states that describe the noise, SI; all axes share their values.

    Parameters
    ----------
    noise : SensorNoise
    horizon : float
        Longest averaging time at which flicker is described, s. Half of the recording's duration is
        used if this is longer.

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
        raise InputError("the analysis has no axes, so there is nothing to write for a filter")
    return "\n".join([*lines, ""])


def _triad_lines(triad: TriadNoise, unit: str, longest: float) -> list[str]:
    dt, limited = 1 / require_rate(triad), ": upper limit (95 %)" if "K" in triad.limits else ""
    white, flicker, walk, markov = (
        root_mean_of_squares([one.get(symbol, 0.0) for one in triad.axes]) for symbol in "NBKG"
    )
    lines = [
        f"  step: {dt:.9g}  # s",
        f"  white_variance: {white**2 * dt:.6e}  # N² Δ, ({unit})² s²"
        if white
        else "  # white_variance: no white noise is stated",
        f"  walk_variance: {walk**2 * dt:.6e}  # K² Δ, ({unit})²{limited}"
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

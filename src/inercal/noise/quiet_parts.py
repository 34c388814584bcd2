"""A recording without its disturbed times, and the random walk with and without them."""

from collections.abc import Sequence

import numpy as np

from inercal.errors import InputError
from inercal.noise.channel_noise import ChannelNoise, Quantity, coefficient_unit
from inercal.noise.disturbances import Disturbance
from inercal.noise.likelihood import NoiseFit
from inercal.noise.pieces import FEWEST, Part
from inercal.units import si_factor

_MARGIN = 1.0  # s, on both sides of a disturbance


def quiet_parts(parts: Sequence[Part], found: Sequence[Disturbance], dt: float) -> list[Part]:
    """Return the pieces that no disturbance, nor 1 s about it, covers.

    Raises
    ------
    InputError
        None has 64 samples.
    """
    kept: list[Part] = []
    for part in parts:
        good = np.ones(len(part) + 1, dtype=bool)
        good[-1] = False
        for one in found:
            seconds = one.seconds if np.isfinite(one.seconds) else 0.0
            first = int((one.time - part.start - _MARGIN) / dt)
            last = int(np.ceil((one.time + seconds - part.start + _MARGIN) / dt))
            good[max(first, 0) : max(last, 0)] = False
        edges = np.flatnonzero(np.diff(np.concatenate([[False], good])))
        spans = [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
        kept += [part.slice_samples(a, b, dt) for a, b in spans if b - a >= FEWEST]
    if not kept:
        raise InputError("nothing of the recording is undisturbed: record again")
    return kept


def walk_remark(channel: ChannelNoise, other: NoiseFit | None, *, kept: bool) -> str:
    """Return K with and without the disturbed times.

    Parameters
    ----------
    channel : ChannelNoise
    other : NoiseFit or None
        Without the disturbed times where `channel` has them, else with them.
    kept : bool
        Whether `channel` has the disturbed times.
    """
    if other is None:
        return "disturbances cover the recording: K without them is not known"
    one, two = (_walk(fit, channel.quantity) for fit in (channel.fit, other))
    with_them, without = (one, two) if kept else (two, one)
    how = "; --skip-disturbed leaves them out" if kept else ""
    return f"K with the disturbed times: {with_them}; without: {without}{how}"


def _walk(fit: NoiseFit, quantity: Quantity) -> str:
    unit = coefficient_unit("K", quantity)
    variance = fit.variance("K")
    return f"{np.sqrt(variance) / si_factor(unit):.3g} {unit}" if variance > 0 else "none"

"""How rates bend between samples: the angle of a step is that of a parabola, not of a trapezoid.

A trapezoid misses −Δt² (α₁ − α₀)/12 of an angle while the acceleration α is not zero: as much at
the start of a turn as at its end, with the other sign, which is what a scale factor does. With the
second derivative ω″ in the middle of a step the angle to a share x of it is, but for Δt⁴ ω‴::

    Δt (ω₀ x + (ω₁ − ω₀) x²/2 − ω″ Δt² (x²/4 − x³/6))

ω″ is the mean of those of the parabolas through the step and the sample before, and after.

**Noise.** A reading counts once in the sum of all steps, but its parts are in two neighbouring
increments where an epoch ends between them: with u = x (1 − x) their covariance is γ(u) σ²,
`neighbour_share`, σ² the variance of a sample's angle. So is that of a random walk that is observed
with noise of the variance −γ σ², which is how filters take account of it.
"""

import numpy as np

from inercal.basics.arrays import Array
from inercal.estimation.kernel_options import kernel_step
from inercal.methods.turntable.strapdown import (
    MAX_STEP_RATIO,
    PARABOLA_ERROR,
    PARABOLA_THRESHOLD,
)


def rate_bends(time: Array, rates: Array, white: Array) -> tuple[Array, Array]:
    """Return ω″ in each step and the variance of its angle by sudden accelerations.

    Parameters
    ----------
    time : (n,) array
        s.
    rates : (n, 3) array
        Readings, rad/s.
    white : (3,) array
        Variance of the integral of each gyro's noise, rad²/s.

    Returns
    -------
    bends : (n, 3) array
        rad/s³, of the step that leads to each sample; zero where steps are too unequal.
    kinks : (n,) array
        rad², of each of the three angles.
    """
    step = np.diff(time, prepend=time[0])[:, None]
    # Of the parabola through each sample and the two before it
    own, known = np.zeros_like(rates), np.zeros(step.shape, dtype=bool)
    last, before = step[2:], step[1:-1]
    known[2:] = (before > 0) & (last <= MAX_STEP_RATIO * before) & (before <= MAX_STEP_RATIO * last)
    slope = np.diff(rates, axis=0) / np.where(step[1:] > 0, step[1:], np.inf)
    own[2:] = np.where(known[2:], 2 * np.diff(slope, axis=0) / np.maximum(last + before, 1e-9), 0.0)
    after, both = np.zeros_like(own), np.zeros_like(known)
    after[:-1], both[:-1] = own[1:], known[1:]
    count = known.astype(np.int64) + both
    third = np.where(count == 2, (after - own) * step**2, 0.0)
    three = np.pad(third, ((2, 0), (0, 0)))
    squares, total = (x[:-2] + x[1:-1] + x[2:] for x in (three**2, three))
    sudden = squares * step > PARABOLA_THRESHOLD * white
    jumps = np.where(sudden, np.maximum(squares - 2 * total**2, 0.0), 0.0)
    kinks = np.sum(jumps * (PARABOLA_ERROR * step) ** 2, axis=1)
    return (own + after) / np.maximum(count, 1), kinks


@kernel_step
def neighbour_share(x: float) -> float:
    """Return γ, by how much of a sample's variance increments correlate that meet at x."""
    u = x * (1 - x)
    return 47 / 288 + u * u * (u / 36 - 5 / 16)

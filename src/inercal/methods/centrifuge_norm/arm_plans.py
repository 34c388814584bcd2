"""Plans for the arm: attitudes at several rates, whole turns each.

Norms determine an axis's coefficients by readings of both signs on it. In the twenty positions of
Wang and Li 2021 ψ covers half a circle, and y never senses the arm from behind; on a full circle
the worst coefficient is known seven times as well from as many dwells.
"""

from collections.abc import Sequence
from math import pi, radians

from inercal.basics.errors import InputError
from inercal.physics.plan import Attitude, Spin, arm_attitude

RATES = (2 * pi, 4 * pi, 6 * pi)
TURNS = 10


def half_circle() -> tuple[Attitude, ...]:
    """Return the twenty positions of the source: ψ = 0 … 180° by 45°, θ = 0 … 180° by 60°."""
    return tuple(arm_attitude(radians(45 * i), radians(60 * j)) for i in range(5) for j in range(4))


def full_circle() -> tuple[Attitude, ...]:
    """Return twenty positions on the full circle: ψ by 72° from 10°, θ = 20°, 110°, 200°, 290°."""
    return tuple(
        arm_attitude(radians(10 + 72 * i), radians(theta))
        for i in range(5)
        for theta in (20, 110, 200, 290)
    )


ATTITUDES = {"full-circle": full_circle, "half-circle": half_circle}


def plan(
    attitudes: str = "full-circle", rates: Sequence[float] = RATES, turns: int = TURNS
) -> tuple[Spin, ...]:
    """Return the dwells, attitude by attitude within each rate.

    Parameters
    ----------
    attitudes : "full-circle" or "half-circle"
    rates : sequence of float
        rad/s, positive in the sense of the bench.
    turns : int
        Whole turns that each dwell is averaged over.

    Raises
    ------
    InputError
        Unknown attitudes, no rate, or a rate of zero.
    """
    if attitudes not in ATTITUDES:
        raise InputError(
            f"attitudes {attitudes!r} are unknown; choose {' or '.join(ATTITUDES)}",
            key="attitudes",
            names=(attitudes,),
        )
    if not rates or not all(rates):
        raise InputError(
            "rates must hold at least one rate, and no rate of 0: at rest there is no dwell on the "
            "arm",
            key="rates",
        )
    return tuple(
        Spin(f"p{k:02d}_r{j}", rate, 2 * pi * turns / abs(rate), attitude)
        for j, rate in enumerate(rates, start=1)
        for k, attitude in enumerate(ATTITUDES[attitudes](), start=1)
    )

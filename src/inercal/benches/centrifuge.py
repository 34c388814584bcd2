"""A precision centrifuge (terms of IEEE Std 836): an arm that turns steadily about the vertical.

A sensor at rest on the arm feels the arm's centripetal acceleration and gravity, at right angles
but for a tilt τ of the arm's end::

    a  = R (1 + s a₀) (ω (1 + ρ) + Ω_up)²,   a₀ = R ω² nominal
    n² = a² + 2 a g τ + g²                     whatever the sensor's attitude

with R the static radius, s the arm's stretch, ω the rate as stated and ρ its relative error, Ω_up
the earth's rate along the spindle, positive where the arm turns as the earth does. A lean of the
spindle in space swings τ once a turn: over whole turns it is not felt. Rate and tilt may differ
from dwell to dwell besides, by `dwell_rate` and `dwell_tilt`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from inercal.parameters import Parameter
from inercal.plan import Spin
from inercal.units import Measured

Array = NDArray[np.float64]
_EXACT = Measured(0.0, 0.0)


@dataclass(frozen=True)
class Centrifuge:
    """The bench of a centrifuge.

    Parameters
    ----------
    gravity : Measured
        Local gravity, m/s².
    radius : Measured
        From the spindle's axis to the sensor's centre, the arm at rest, m.
    stretch : Measured
        Relative growth of the radius per centripetal acceleration, 1/(m/s²).
    rate : float
        Relative standard deviation of the rate, common to the run.
    tilt : float
        Standard deviation of the arm's tilt, common to the run, rad.
    earth_up : Measured
        The earth's rate along the spindle, rad/s; negative where the arm turns against it.
    dwell_rate : float
        Relative standard deviation of each dwell's rate.
    dwell_tilt : float
        Standard deviation of each dwell's tilt, rad.
    """

    gravity: Measured
    radius: Measured
    stretch: Measured = field(default=_EXACT)
    rate: float = 0.0
    tilt: float = 0.0
    earth_up: Measured = field(default=_EXACT)
    dwell_rate: float = 0.0
    dwell_tilt: float = 0.0

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The imperfections that a whole run shares, as data."""
        g, r, s, up = self.gravity, self.radius, self.stretch, self.earth_up
        return (
            Parameter("g", "m/s²", g.sd, "run", g.value, "local gravity"),
            Parameter("radius", "m", r.sd, "run", r.value, "static radius"),
            Parameter("stretch", "(m/s²)⁻¹", s.sd, "run", s.value, "stretch of the arm"),
            Parameter("rate", "1", self.rate, "run", 0.0, "rate of the arm, relative"),
            Parameter("tilt", "rad", self.tilt, "run", 0.0, "tilt of the arm"),
            Parameter("earth_up", "rad/s", up.sd, "run", up.value, "earth rate along the spindle"),
        )


@dataclass(frozen=True, eq=False)
class FeltNorm:
    """Norm of specific force in each dwell, and how it depends on the bench.

    Parameters
    ----------
    norm : (..., r) array
        n, m/s².
    by : mapping of str to (..., r) array
        ∂n by each of the bench's parameters.
    dwell : (..., r) array
        Standard deviation of n by what differs from dwell to dwell, m/s².
    """

    norm: Array
    by: Mapping[str, Array]
    dwell: Array


def felt_norm(bench: Centrifuge, steps: Sequence[Spin], q: Mapping[str, Array]) -> FeltNorm:
    """Return the norm that each dwell makes.

    Parameters
    ----------
    bench : Centrifuge
    steps : sequence of r Spin
    q : mapping of str to (...) array
        The bench's parameters by name, SI; all of them.
    """
    w = np.array([step.rate for step in steps])
    g, radius, stretch, rate, tilt, up = (
        q[name][..., None] for name in ("g", "radius", "stretch", "rate", "tilt", "earth_up")
    )
    nominal = bench.radius.value * w**2
    grown = 1 + stretch * nominal
    turned = w * (1 + rate) + up
    a = radius * grown * turned**2
    n = np.sqrt(a**2 + 2 * a * g * tilt + g**2)
    by_a = (a + g * tilt) / n
    by_rate = by_a * 2 * radius * grown * turned
    by = {
        "g": (a * tilt + g) / n,
        "radius": by_a * grown * turned**2,
        "stretch": by_a * radius * nominal * turned**2,
        "rate": by_rate * w,
        "tilt": a * g / n,
        "earth_up": by_rate,
    }
    dwell = np.hypot(by["rate"] * bench.dwell_rate, by["tilt"] * bench.dwell_tilt)
    return FeltNorm(n, by, dwell)

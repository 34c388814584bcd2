"""The temperatures around a bench, and the errors that they add.

A run spans temperatures as soaks, in which the plan is carried out at one temperature after the
other, or as a ramp, in which the temperature moves. The rows of a soak share two errors: that of
its temperature, which acts on the readings by their slope against temperature, and that of the
bias, which repeats with a scatter from soak to soak.
"""

from dataclasses import dataclass, field
from typing import Literal

from inercal.basics.units import Measured

EnvironmentKind = Literal["soaks", "ramp"]


@dataclass(frozen=True)
class ChamberProfile:
    """The set temperatures of a chamber in a simulation.

    Parameters
    ----------
    temperatures : tuple of float
        K: of the soaks in their order, or the turning points of a ramp.
    rate : float
        K/s, of the chamber between them.
    wait : float
        s, at each soak before the plan, or at the first temperature of a ramp.
    case_time : float
        Time constant by which the sensor follows the chamber, s.
    """

    temperatures: tuple[float, ...] = ()
    rate: float = 0.0
    wait: float = 0.0
    case_time: float = 0.0


@dataclass(frozen=True)
class Environment:
    """[environment] of a run file, SI.

    Parameters
    ----------
    kind : "soaks" or "ramp"
    temperature_sd : float
        Standard deviation of the error of the temperature that the rows of a soak, or all of a
        ramp, have in common, K.
    force_repeatability, rate_repeatability : float
        Standard deviation of the bias of an accelerometer, m/s², or a gyro, rad/s, from soak to
        soak.
    lag : Measured or None
        Time by which the recorded temperature is behind that of the sensing element, s; None is
        unknown: a ramp estimates it, and soaks neglect it.
    profile : ChamberProfile
        Of a simulation.
    warm_up : float
        Time constant of a warm-up of the biases in a ramp, s; 0 is none.
    """

    kind: EnvironmentKind
    temperature_sd: float = 0.0
    force_repeatability: float = 0.0
    rate_repeatability: float = 0.0
    lag: Measured | None = None
    profile: ChamberProfile = field(default_factory=ChamberProfile)
    warm_up: float = 0.0


__all__ = ["ChamberProfile", "Environment", "EnvironmentKind"]

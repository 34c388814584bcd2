"""Temperatures around a bench, and the errors that they add.

A run covers several temperatures in one of two ways: as soaks, where the plan is carried out at one
temperature after another, or as a ramp, where the temperature changes continuously. The rows of a
soak share two errors. One is the error of its temperature, which acts on the readings through their
temperature slope. The other is the bias, whose repeatability from soak to soak is limited.
"""

from dataclasses import dataclass, field
from typing import Literal

from inercal.basics.units import Measured

EnvironmentKind = Literal["soaks", "ramp"]


@dataclass(frozen=True)
class ChamberProfile:
    """The set temperatures of a chamber, for simulations.

    Parameters
    ----------
    temperatures : tuple of float
        Temperatures of the soaks in their order, or turning points of a ramp, K.
    rate : float
        Rate at which the chamber changes between them, K/s.
    wait : float
        Waiting time at each soak before the plan starts, or at the first temperature of a ramp, s.
    case_time : float
        Time constant with which the sensor follows the chamber, s.
    """

    temperatures: tuple[float, ...] = ()
    rate: float = 0.0
    wait: float = 0.0
    case_time: float = 0.0


@dataclass(frozen=True)
class Environment:
    """The [environment] section of a run file, in SI units.

    Parameters
    ----------
    kind : "soaks" or "ramp"
    temperature_sd : float
        Standard deviation of the temperature error that all rows of a soak, or of a ramp, share, K.
    force_repeatability, rate_repeatability : float
        Standard deviation of the bias from soak to soak, for an accelerometer, m/s², and a gyro,
        rad/s.
    lag : Measured or None
        Time by which the recorded temperature lags behind the sensing element, s. None means
        unknown: a ramp then estimates it, and soaks neglect it.
    profile : ChamberProfile
        Set temperatures, for a simulation.
    warm_up : float
        Time constant of a bias warm-up during a ramp, s; 0 means no warm-up.
    """

    kind: EnvironmentKind
    temperature_sd: float = 0.0
    force_repeatability: float = 0.0
    rate_repeatability: float = 0.0
    lag: Measured | None = None
    profile: ChamberProfile = field(default_factory=ChamberProfile)
    warm_up: float = 0.0


__all__ = ["ChamberProfile", "Environment", "EnvironmentKind"]

"""Describe the temperatures around a bench and the errors that they cause.

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
    """The set temperatures of a chamber, for simulations and for a host that drives a chamber.

    Parameters
    ----------
    temperatures : tuple of float
        Temperatures of the soaks in their order, or turning points of a ramp, K.
    rate : float
        Rate at which the chamber changes between them, K/s.
    wait : float
        Waiting time at each soak before the plan starts, or at the first temperature of a ramp, s.
        A host waits at least this long.
    case_time : float
        Time constant with which the sensor follows the chamber, s.
    """

    temperatures: tuple[float, ...] = ()
    rate: float = 0.0
    wait: float = 0.0
    case_time: float = 0.0


@dataclass(frozen=True)
class SoakCriteria:
    """The conditions under which a soak is stable, and those that end a run in a chamber.

    Parameters
    ----------
    tolerance : float
        Largest difference between the chamber and its set temperature, K.
    drift : float
        Largest drift of the sensor's own temperature, K/s.
    steady_time : float
        Time for which tolerance and drift must be kept before the plan starts, s.
    longest_wait : float
        Time after which a run ends if the soak is still not stable, s.
    limits : (float, float) or None
        Lowest and highest permitted temperature of chamber and sensor, K.
    max_rate : float
        Largest permitted rate of the chamber's temperature, K/s.
    """

    tolerance: float = 1.0
    drift: float = 0.1 / 60
    steady_time: float = 600.0
    longest_wait: float = 3 * 3600.0
    limits: tuple[float, float] | None = None
    max_rate: float = 10 / 60


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
        Set temperatures, for a simulation or a run in a chamber.
    warm_up : float
        Time constant of a bias warm-up during a ramp, s; 0 means no warm-up.
    criteria : SoakCriteria
        Criteria of a run in a chamber.
    """

    kind: EnvironmentKind
    temperature_sd: float = 0.0
    force_repeatability: float = 0.0
    rate_repeatability: float = 0.0
    lag: Measured | None = None
    profile: ChamberProfile = field(default_factory=ChamberProfile)
    warm_up: float = 0.0
    criteria: SoakCriteria = field(default_factory=SoakCriteria)

    @property
    def soaks(self) -> tuple[float, ...]:
        """Set temperatures of the soaks, K; empty for a ramp, or if none are stated."""
        return self.profile.temperatures if self.kind == "soaks" else ()

"""The two filters as the estimators have them, and what they have found so far."""

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.benches.turntable.bench import Turntable
from inercal.estimate import Gaussian
from inercal.methods.turntable import model
from inercal.methods.turntable.model import ARCSEC
from inercal.methods.turntable_kalman import _accelerometers, _readback
from inercal.methods.turntable_kalman.accelerometers import STILL, Accelerometers
from inercal.methods.turntable_kalman.common import averaging
from inercal.methods.turntable_kalman.gyros import Gyros
from inercal.recording import Track
from inercal.sensors import Sensor

Array = NDArray[np.float64]
_SOURCES_STILL = 1e-3  # m/s


class Way(NamedTuple):
    """Which states the filters have, and how far attitude and velocity at rest are trusted."""

    drifting: bool
    table: bool  # right angles and harmonics in the gyros' filter
    holding_table: Literal["whole", "lean", "exact"]  # in the accelerometers'
    source: tuple[float, float] | None  # rad, of the attitude in each filter; None is the bench's
    still: float  # m/s

    def readback(self, bench: Turntable) -> tuple[float, float | None]:
        """Return what the gyros' and the accelerometers' filter take of the readback, rad."""
        return self.source or (max(bench.white, model.FLOOR), None)


WAYS: Mapping[str, Way] = {
    "full": Way(True, True, "whole", None, STILL),
    "drift": Way(True, False, "lean", (4 * ARCSEC, ARCSEC), _SOURCES_STILL),
    "paper": Way(False, False, "exact", (10 * ARCSEC, 10 * ARCSEC), _SOURCES_STILL),
}


class Found(NamedTuple):
    """What a filter has found so far: its states' values from the coefficients on."""

    value: Array  # (s,)
    covariance: Array  # (s, s)
    shared: Array  # (p, p), part of the coefficients' that no innovation shows: gravity's


def gyros_filter(
    sensor: Sensor,
    bench: Turntable,
    track: Track,
    way: Way,
    priors: Sequence[Gaussian] = (),
    lasting: float | None = None,
) -> Gyros:
    """Return the gyros' filter of an estimator; arguments as of `Gyros.of`."""
    return Gyros.of(
        sensor, bench, track, priors,
        drifting=way.drifting, table=way.table, readback=way.readback(bench)[0], lasting=lasting,
    )  # fmt: skip


def accelerometers_filter(
    sensor: Sensor,
    bench: Turntable,
    track: Track,
    way: Way,
    priors: Sequence[Gaussian] = (),
    lasting: float | None = None,
) -> Accelerometers:
    """Return the accelerometers' filter of an estimator; arguments as of `Accelerometers.of`."""
    return Accelerometers.of(
        sensor, bench, track, priors,
        drifting=way.drifting, table=way.holding_table, readback=way.readback(bench)[1],
        still=way.still, lasting=lasting,
    )  # fmt: skip


def of_gyros(made: Gyros, state: _readback.State) -> Found:
    """Return what the gyros' filter has found."""
    p = len(made.first)
    value = state.x[3:].copy()
    value[:p] += state.theta
    value, covariance = _averaged(made, value, state.p[3:, 3:], state)
    return Found(value, covariance, np.zeros((p, p)))


def of_accelerometers(made: Accelerometers, state: _accelerometers.State) -> Found:
    """Return what the accelerometers' filter has found."""
    p, g = len(made.first), made.bench.gravity
    value = state.x[6:].copy()
    value[:p] = state.theta
    along = model.of_gravity(made.part) * g.sd / g.value
    shared = np.outer(along, along)
    value, covariance = _averaged(made, value, state.p[6:, 6:].copy(), state)
    covariance[:p, :p] += shared
    return Found(value, covariance, shared)


def _averaged(
    made: Gyros | Accelerometers,
    value: Array,
    covariance: Array,
    state: _readback.State | _accelerometers.State,
) -> tuple[Array, Array]:
    """Return states from the coefficients on with biases as means over the run so far."""
    if not made.part.drift.averaged:
        return value, covariance
    sample, epoch, start = state.time[:3].tolist()
    states = made.states[len(made.states) - len(value) :]
    by, variance = averaging(made.part, states, sample - start, sample - epoch)
    by += np.eye(len(by))
    return by @ value, by @ covariance @ by.T + np.diag(variance)


def observed(made: Gyros | Accelerometers) -> int:
    """Return how many components an epoch of a filter has."""
    if isinstance(made, Gyros):
        return 3
    # At rest a readback that is stated as exact is: what it leaves of the floor tests nothing.
    return 3 if made.readback is None and made.bench.white == 0 else 5

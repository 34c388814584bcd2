"""Fit the readings to a turntable's readback as recorded, and with exchanged columns or signs.

All fits use means over 0.1 s of the readings and of the motion that the readback implies
(`inercal.benches.turntable.attitude.motion` at the table's nominal values). The readings y of axes
along the rows of A are consistent with a faultless sensor in the motion p if the cost is small::

    J = min over D, b of  Σ|y − (A + D) p − b|² / (0.05² S) + Σ D² / 0.1²

where S is the sum of squares of the readings about their mean. Scale factor errors of 5 % and
misalignments of 5° cost about 5, and a bias costs nothing. A reversed or exchanged axis costs more
than 100.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.benches.stated_axes import (
    SignedPermutation,
    identity_permutation,
    signed_permutations,
)
from inercal.benches.turntable.attitude import motion
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.reading.sample_checks import wild_samples
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import GAP_FACTOR, Track, sample_count

MAX_SOUND_COST = 30.0
"""Largest cost for a faultless sensor."""
_BLOCK = 0.1  # s
_MOST = 4000  # blocks; more of them add no information
_MISFIT, _SOUND = 0.05, 0.1
_LEAST = {"w": np.radians(1), "f": 0.05 * G0}  # smallest change of the readings, rad/s or m/s²


def _column_exchanges(k: int) -> tuple[SignedPermutation, ...]:
    return signed_permutations(k) if k <= len("xyz") else (identity_permutation(k),)


@dataclass(frozen=True, eq=False)
class BlockMeans:
    """Means over 0.1 s of time, axis angles and rates, and the readings of each kind, in SI."""

    time: Array  # (b,)
    angles: Array  # (b, k)
    rates: Array  # (b, k)
    readings: dict[str, Array]  # (b, m) by "f" and "w"
    step: float  # s between samples

    @cached_property
    def is_still(self) -> NDArray[np.bool_]:
        """Whether the readback is constant in each block, (b,), relative to the fastest rate."""
        speed = np.abs(self.rates)
        fastest = np.percentile(speed, 99.5, axis=0)
        # If an axis never turns, its rate is only noise.
        return np.all(speed <= np.maximum(0.02 * fastest, 1e-3 * fastest.max()), axis=-1)

    def subsample(self) -> "BlockMeans":
        """Return at most `_MOST` blocks, evenly spread over the run."""
        at = slice(None, None, -(-self.time.size // _MOST))
        readings = {kind: y[at] for kind, y in self.readings.items()}
        return BlockMeans(self.time[at], self.angles[at], self.rates[at], readings, self.step)


def block_means(track: Track, sensor: Sensor) -> BlockMeans:
    """Return the means of one trial's track, (n, m) readings, over blocks without gap or spike."""
    step = float(np.median(np.diff(track.time)))
    size = max(sample_count(_BLOCK, step), 1)
    first = np.arange(0, track.time.size - size, size)
    last = first + size
    span = track.time[last] - track.time[first]
    complete = span < (size + GAP_FACTOR - 1) * step
    for axis, column in zip(sensor.axes, track.reading.T, strict=False):
        for start, stop in wild_samples(column, axis.measures).tolist():
            complete[start // size : (stop - 1) // size + 1] = False
    turned = (track.angles[last] - track.angles[first]) / span[:, None]
    mean = np.add.reduceat(track.reading[: last[-1]], first, axis=0) / size
    readings = {
        kind: mean[complete][:, [axis.measures == kind for axis in sensor.axes]] for kind in "fw"
    }
    middle = (track.angles[first] + track.angles[last]) / 2
    time = track.time[first][complete]
    return BlockMeans(time, middle[complete], turned[complete], readings, step)


class Moments(NamedTuple):
    """Sums of products of readings y of m axes and the motion p about their means."""

    yy: Array  # (m, m)
    yp: Array  # (m, 3)
    pp: Array  # (3, 3)
    axes: Array  # (m, 3), input axes A
    minimum_sum: float  # lower limit for the sum of squares of y about its mean

    def cost(self, way: SignedPermutation | None = None) -> float:
        """Return the cost J for the readings as recorded, or exchanged by `way`."""
        way = way or identity_permutation(len(self.axes))
        yp = self.yp[list(way.order)] * np.array(way.signs)[:, None]
        total = max(float(np.trace(self.yy)), self.minimum_sum)
        weight = total * (_MISFIT / _SOUND) ** 2
        off = yp - self.axes @ self.pp
        d = np.linalg.solve(self.pp + weight * np.eye(3), off.T).T
        a = d + self.axes
        residual = np.trace(self.yy) - 2 * np.sum(a * yp) + np.sum((a @ self.pp) * a)
        return float(residual / total / _MISFIT**2 + np.sum(d**2) / _SOUND**2)

    def factors(self) -> Array:
        """Return the ratio of each reading's change to its expected change, (m,)."""
        return np.sum(self.yp @ np.linalg.pinv(self.pp, rcond=1e-3) * self.axes, axis=-1)


def moments(
    bench: Turntable, sensor: Sensor, made: BlockMeans, way: SignedPermutation, times: float = 1.0
) -> dict[str, Moments]:
    """Return the moments for a sensor's accelerometers and gyros, by "f" and "w".

    Parameters
    ----------
    bench : Turntable
    sensor : Sensor
    made : BlockMeans
    way : SignedPermutation
        Exchange of the readback's columns.
    times : float
        Factor by which the readback is multiplied.
    """
    angles, rates = times * way.reorder(made.angles), times * way.reorder(made.rates)
    sensed = motion(bench, angles, rates, np.zeros_like(rates), {})
    found: dict[str, Moments] = {}
    for kind, u in (("f", sensed.f), ("w", sensed.w)):
        y, p = (x - x.mean(axis=0) for x in (made.readings[kind], u))
        axes = np.array([axis.i for axis in sensor.axes if axis.measures == kind])
        if len(axes):
            least = len(y) * _LEAST[kind] ** 2
            found[kind] = Moments(y.T @ y, y.T @ p, p.T @ p, axes, least)
    return found


class ExchangeFit(NamedTuple):
    """Exchanges that make readings and readback agree, and their largest cost."""

    cost: float
    readback: SignedPermutation
    gyro: SignedPermutation
    accelerometer: SignedPermutation


def find_exchanges(bench: Turntable, sensor: Sensor, made: BlockMeans) -> tuple[ExchangeFit, ...]:
    """Return the simplest exchanges that explain the readings.

    The simplest exchanges are of the readback's columns, of one triad, or of both triads together
    (another mounting of the IMU). Different exchanges of both triads come next, then exchanges of
    readback and triads. Fewer than three axes of a kind can fit several exchanges of the readback,
    so only their own columns are exchanged, and more than three axes are not exchanged.
    """
    by = {
        table: moments(bench, sensor, made, table) for table in signed_permutations(len(bench.axes))
    }
    own = [_best_exchange(*next(iter(by.items())))]
    triads = all(len(m.axes) == 3 for m in next(iter(by.values())).values())
    for found in (_simple_exchanges(by) if triads else [], own):
        sound = [fit for fit in found if fit.cost <= MAX_SOUND_COST]
        if sound:
            return tuple(sorted(sound))
    if not triads:
        return ()
    every = min(_best_exchange(table, of) for table, of in by.items())
    return (every,) if every.cost <= MAX_SOUND_COST else ()


def alternative_axis_orders(
    bench: Turntable, sensor: Sensor, made: BlockMeans
) -> tuple[tuple[float, str], ...]:
    """Return other orders of the axes, with their costs, for which the columns fit unchanged."""
    k = len(bench.axes)
    found: list[tuple[float, str]] = []
    for axes in map("".join, permutations("xyz", k)):
        if axes != bench.axes:
            by = moments(replace(bench, axes=axes), sensor, made, identity_permutation(k))
            found.append((max(m.cost() for m in by.values()), axes))
    return tuple(sorted(one for one in found if one[0] <= MAX_SOUND_COST))


def _simple_exchanges(by: dict[SignedPermutation, dict[str, Moments]]) -> list[ExchangeFit]:
    """Return the best exchanges of the readback, of each triad, and of both triads together."""
    ways, (table, triads) = signed_permutations(3), next(iter(by.items()))
    same = ways[0]
    w, f = ([triads[kind].cost(way) if kind in triads else 0.0 for way in ways] for kind in "wf")
    tables = [
        ExchangeFit(max(m.cost() for m in each.values()), one, same, same)
        for one, each in by.items()
    ]
    gyros = [ExchangeFit(max(w[k], f[0]), table, way, same) for k, way in enumerate(ways)]
    forces = [ExchangeFit(max(w[0], f[k]), table, same, way) for k, way in enumerate(ways)]
    both = [ExchangeFit(max(w[k], f[k]), table, way, way) for k, way in enumerate(ways)]
    return [min(some) for some in (tables, gyros, forces, both)]


def _best_exchange(table: SignedPermutation, triads: dict[str, Moments]) -> ExchangeFit:
    """Return the best exchange of each kind of axes, independently of the other."""
    best = {
        kind: min((m.cost(way), way) for way in _column_exchanges(len(m.axes)))
        for kind, m in triads.items()
    }
    ways = [best[kind][1] if kind in best else identity_permutation(3) for kind in "wf"]
    return ExchangeFit(max(cost for cost, _ in best.values()), table, ways[0], ways[1])

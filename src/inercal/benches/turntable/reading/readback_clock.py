"""Interpolate the readback of a turntable with its own clock to the times of the IMU.

The table's clock shows T = t + o + d (t − t₀) when the IMU's clock shows t, where t₀ is the time of
the IMU's first sample. Each stretch in which the rate changes gives a local offset with its
standard deviation (`implied_rates`). o and d follow from these offsets by weighted least squares. A
latency of the readback is part of o, so after `align_readback` it is zero within its standard
deviation.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from dataclasses import dataclass
from math import sqrt

import numpy as np
import scipy

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.reading import implied_rates as implied
from inercal.benches.turntable.reading.implied_rates import LocalOffsets, WindowedRates

MAX_CLOCK_OFFSET = 1.0  # s, largest offset
MAX_CLOCK_DRIFT = 1e-3  # largest relative rate between the clocks
_GRID = 0.02  # s, grid of the first search
_MOVING = np.radians(1)  # rad/s
_PAUSE = 0.5  # s: moves that are closer together are matched as one
_MARGIN = 0.2  # s in addition to the possible effect of offset and drift
_ROUNDS = 6
_FEWEST = 20  # samples
_HUBER = 1.5  # standard deviations beyond which an offset gets less weight
_MIDDLE = 0.6745  # median magnitude of a standard normal number
_ALIKE = 0.2  # times the readings' changes; for the same motion, residuals are far smaller
_ALIKE_SPEEDS = 0.9  # correlation
_STANDS = np.radians(0.1)  # rad/s
_BEYOND = 2.0  # s by which the IMU's times may extend beyond the readback's times
_NO_ANGLES: Array = np.zeros((0, 0))


class ClockMismatch(InputError):
    """Readback and gyros show different turns at the same times, or the readback is constant.

    Parameters
    ----------
    message : str
    angles : (n, k) array
        Readback at the IMU's times, rad, aligned only by speed, from which exchanged columns can be
        identified.
    """

    def __init__(self, message: str, angles: Array = _NO_ANGLES) -> None:
        super().__init__(message)
        self.angles = angles


@dataclass(frozen=True, eq=False)
class ClockAlignment:
    """The readback at the IMU's times, with the estimated relation of the clocks.

    Parameters
    ----------
    angles : (n, k) array
        Readback at the IMU's times, rad.
    offset, drift : float
        Offset o, s, and relative drift d in T = t + o + d (t − t₀).
    offset_sd, drift_sd, correlation : float
        Standard deviations of offset and drift, and their correlation. They are enlarged if the
        local offsets scatter more than their own standard deviations predict.
    time, local : (e,) arrays
        Times and local offsets T − t for each stretch in which the rate changes, s, on the IMU's
        clock.
    """

    angles: Array
    offset: float
    drift: float
    offset_sd: float
    drift_sd: float
    correlation: float
    time: Array
    local: Array


def align_readback(
    bench: Turntable,
    time: Array,
    rates: Array,
    table_time: Array,
    angles: Array,
    about: float = 0.0,
) -> ClockAlignment:
    """Align the readback with the gyros by their rates; return it at the IMU's times.

    Parameters
    ----------
    bench : Turntable
    time : (n,) array
        Times on the IMU's clock, s.
    rates : (n, 3) array
        Readings of the gyros, rad/s; bias, scale and misalignment need not be corrected.
    table_time : (r,) array
        Times on the readback's own clock, s; its rate may differ by 1000 ppm.
    angles : (r, k) array
        Readback, cumulative over whole turns, rad.
    about : float
        Expected offset, s; the search covers ±1 s around it.

    Returns
    -------
    ClockAlignment
        The alignment. Angles are interpolated by cubics and are constant before the first and after
        the last reading.

    Raises
    ------
    InputError
        Times do not increase, there are fewer than two changes of rate, more than 2 s at the start
        or end of the readings are not covered by the readback, it begins or ends during a turn, or
        table and gyros do not turn at the same times at any offset.
    ClockMismatch
        Both show turns at the same times, but different ones, because columns or units are wrong.
    """
    for name, clock in (("time", time), ("the readback's time", table_time)):
        if clock.size < _FEWEST:
            raise InputError(
                f"{name} has {clock.size} samples; record at least {_FEWEST}", names=(name,)
            )
        if (np.diff(clock) <= 0).any():
            raise InputError(
                f"{name} does not increase from sample to sample; check its column", names=(name,)
            )
    origin, shift = float(time[0]), float(time[0]) + about
    reach = MAX_CLOCK_OFFSET + MAX_CLOCK_DRIFT * float(time[-1] - time[0])
    _require_span(time + about, table_time, reach)
    time, table_time = time - origin, table_time - shift
    table, gyros = implied.table_rates(bench, table_time, angles), implied.gyro_rates(time, rates)
    if (near := _search(table, gyros)) is None:
        raise ClockMismatch(
            "the offset of the readback's clock cannot be estimated: the table never turns in the "
            "readback; check its columns and unit",
            _interpolate_angles(table_time, angles, time),
        )
    refined = _refine_alignment(table, gyros, near)
    if refined is None:
        words = (
            "the rates of readback and gyros differ at every clock offset within ±1 s; check that "
            "both are from the same run, and check their columns and units, including time"
        )
        if not _motions_coincide(table, gyros, near):
            raise InputError(words)
        raise ClockMismatch(
            words, _interpolate_angles(table_time, angles, time + near[1] + near[0] * time)
        )
    late, covariance, found = refined
    said = np.asarray(time + late[1] + late[0] * time, dtype=float)
    _require_span(said + shift, table_time + shift, 0.0)
    for end, beyond in ((0, said[0] < table_time[0]), (-1, said[-1] > table_time[-1])):
        if beyond and np.linalg.norm(table.rate[end]) > _STANDS:
            raise InputError(
                f"the readback {'begins' if end == 0 else 'ends'} while the table turns; cut "
                "the sensor's recording to the time that the readback covers"
            )
    drift_sd, offset_sd = sqrt(covariance[0, 0]), sqrt(covariance[1, 1])
    return ClockAlignment(
        _interpolate_angles(table_time, angles, said),
        float(late[1]) + about,
        float(late[0]),
        offset_sd,
        drift_sd,
        float(covariance[0, 1]) / (offset_sd * drift_sd),
        found.time + origin,
        found.value + about,
    )


def _require_span(said: Array, table_time: Array, reach: float) -> None:
    """Refuse readings that the readback does not cover at any clock offset up to `reach`."""
    slack = reach + _BEYOND
    if table_time[0] - slack <= said[0] and said[-1] <= table_time[-1] + slack:
        return
    raise InputError(
        f"the readback covers {table_time[0]:.6g} s to {table_time[-1]:.6g} s of the table's "
        f"clock, but the recording covers {said[0]:.6g} s to {said[-1]:.6g} s; cut the recording, "
        "or state to within "
        '1 s how far that clock is ahead, such as [bench] latency = "12.5 s"',
        names=("[bench] latency",),
    )


def _refine_alignment(
    table: WindowedRates, gyros: WindowedRates, late: Array
) -> tuple[Array, Array, LocalOffsets] | None:
    """Return drift and offset, (2,), their covariance, and the local offsets T − t.

    The result is None if the rates do not agree.
    """
    for _ in range(_ROUNDS - 1):
        late = _fit_line(_local_offsets(table, gyros, late)[0])[0]
    found, left = _local_offsets(table, gyros, late)
    swing = float(np.std(gyros.rate - gyros.rate.mean(axis=0)))
    return None if left > _ALIKE * swing else (*_fit_line(found), found)


def _local_offsets(
    table: WindowedRates, gyros: WindowedRates, late: Array
) -> tuple[LocalOffsets, float]:
    """Return local offsets T − t relative to a line, and the residual of the rates, rad/s."""
    said = np.asarray(gyros.time + late[1] + late[0] * gyros.time)
    here = _resample_rates(table, said)
    few = (
        "the recording has fewer than two changes of rate; the offset and the rate of the "
        "readback's clock need moves at the beginning and at the end of a run"
    )
    if np.count_nonzero(here.is_complete) < _FEWEST:
        raise InputError(few)
    known = implied.fit_rates(gyros.rate[here.is_complete], here.rate[here.is_complete])
    residual = known.residual_rates(gyros.rate, here.rate)
    found = implied.local_offsets(here, residual, known)
    if len(found.time) < 2:
        raise InputError(few)
    time = (found.time - late[1]) / (1 + late[0])  # from the table's clock to the IMU's
    value = found.value + late[1] + late[0] * time
    return LocalOffsets(time, value, found.sd, found.spans), known.sd


def _interpolate_angles(table_time: Array, angles: Array, said: Array) -> Array:
    """Interpolate angles by Hermite cubics with slopes from central differences."""
    slopes = np.gradient(angles, table_time, axis=0)
    within = np.clip(said, table_time[0], table_time[-1])
    return np.asarray(scipy.interpolate.CubicHermiteSpline(table_time, angles, slopes)(within))


def _resample_rates(table: WindowedRates, said: Array) -> WindowedRates:
    """Return the readback's rates at other times on its clock."""
    rate, change = np.empty((said.size, 3)), np.empty((said.size, 3))
    for k in range(3):
        rate[:, k] = np.interp(said, table.time, table.rate[:, k])
        change[:, k] = np.interp(said, table.time, table.change[:, k])
    whole = np.interp(said, table.time, table.is_complete) > 0.999
    whole &= (said >= table.time[0]) & (said <= table.time[-1])
    return WindowedRates(said, rate, change, whole)


def _search(table: WindowedRates, gyros: WindowedRates) -> Array | None:
    """Return drift and offset to within about 10 ms, (2,), from the speeds during each move.

    The result is None if nothing moves.
    """
    speed = np.linalg.norm(table.rate, axis=-1)
    size = np.linalg.norm(gyros.rate - np.median(gyros.rate, axis=0), axis=-1)
    at = np.flatnonzero(speed > _MOVING)
    if not at.size:
        return None
    cut = np.flatnonzero(np.diff(table.time[at]) > _PAUSE)
    moves = zip(
        table.time[np.concatenate([at[:1], at[cut + 1]])],
        table.time[np.concatenate([at[cut], at[-1:]])],
        strict=True,
    )
    middles, lates = [0.0], [0.0]
    offset = MAX_CLOCK_OFFSET  # the first move determines it
    for first, last in moves:
        middle = (first + last) / 2
        reach = offset + _MARGIN + 2 * MAX_CLOCK_DRIFT * (middle - middles[-1])
        offset = 0.0
        t = np.arange(first - _PAUSE, last + _PAUSE, _GRID)
        seen = np.asarray(np.interp(t, table.time, speed), dtype=float)
        tried = lates[-1] + np.arange(-reach, reach + _GRID, _GRID)
        shifted: list[Array] = [np.interp(t - late, gyros.time, size) for late in tried.tolist()]
        miss = [float(np.linalg.norm(one - seen)) for one in shifted]
        middles.append(middle)
        lates.append(float(tried[np.argmin(miss)]))
    if len(middles) < 4:
        return np.array([0.0, np.median(lates[1:])])
    line = np.polyfit(np.array(middles[1:]) - np.array(lates[1:]), lates[1:], 1)
    return np.asarray(line, dtype=float)


def _motions_coincide(table: WindowedRates, gyros: WindowedRates, late: Array) -> bool:
    """Return whether readback and gyros show turns at the same times, about any axes."""
    said = gyros.time + late[1] + late[0] * gyros.time
    speeds = [np.linalg.norm(one.rate, axis=-1) for one in (_resample_rates(table, said), gyros)]
    return float(np.corrcoef(*speeds)[0, 1]) > _ALIKE_SPEEDS


def _fit_line(found: LocalOffsets) -> tuple[Array, Array]:
    """Return slope and value at zero, (2,), and their covariance, enlarged by the scatter.

    Outlying offsets, such as those after a lost sample, get less weight (Huber).
    """
    columns = np.stack([found.time, np.ones_like(found.time)], axis=-1)
    sd, line, covariance = found.sd, np.zeros(2), np.eye(2)
    for _ in range(_ROUNDS):
        design = columns / sd[:, None]
        covariance = np.asarray(np.linalg.inv(design.T @ design), dtype=float)
        line = covariance @ design.T @ (found.value / sd)
        residual = np.abs(found.value - columns @ line) / found.sd
        usual = max(float(np.median(residual)) / _MIDDLE, 1.0)
        sd = found.sd * np.maximum(residual / (_HUBER * usual), 1.0) ** 0.5
    excess = float(np.sum(((found.value - columns @ line) / sd) ** 2)) / max(found.time.size - 2, 1)
    return line, covariance * max(excess, 1.0)

"""A turntable's gyro filter over four minutes at 200 Hz, and both filters over half an hour.

A peer is filterpy's KalmanFilter of 15 states with NumPy for the strapdown: Φ and Q of each sample,
predicted at 200 Hz and updated by the table's attitude at 10 Hz, with the same feedback. The limit
is gyro_filter.cpp, where a compiler is: 18 states, propagated as ours do, the covariance at 10 Hz;
it has no tests, no history and no smoother, and no terms but these twelve. All find the same
coefficients. Both filters over 30 min at 200 Hz, 19 and 25 states, are held to a second, and of a
run that goes on, with an estimate after each 20 ms, to a share of a core.
"""

import ctypes
from collections.abc import Callable
from math import radians
from pathlib import Path
from time import process_time

import numpy as np
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray
from tests.accuracy import turntable
from tests.accuracy.turntable_filters import cross, kron, small_rotation, small_rotation_vector
from tests.methods.turntable_cases import ARCSEC, bench, columns, sensor, track

from benchmarks import Row, Skipped, best
from benchmarks._compiled import library, pointer
from inercal.benches import Turntable
from inercal.methods.turntable_kalman import FilterPair
from inercal.methods.turntable_kalman.accelerometers import AccelerometerFilter
from inercal.methods.turntable_kalman.filter_config import FILTER_CONFIGS
from inercal.methods.turntable_kalman.gyros import GyroFilter
from inercal.recordings import Track

Array = NDArray[np.float64]
CODE = Path(__file__).with_name("gyro_filter.cpp")
HZ = 200.0
LIMIT = 1.0  # s
LIVE_LIMIT, LIVE_PIECE = 2.0, 4  # % of a core; samples
READBACK, EVERY = 10 * ARCSEC, 20  # rad, and samples from one to the next
# Long enough that setting up, some ms, is not a part of it.
SHORT = [("warm-up", (0, 0, 0), 20.0), *turntable.turns(1080.0, 30.0, back=True)[:-1]]
# 30 min: the note's path with positions of two and a half minutes.
LONG = turntable.complete_path(120.0)


def gyro_filter(table: Turntable, one: Track) -> GyroFilter:
    """Return the filter of a recording, without a drift of the biases."""
    return GyroFilter.from_track(
        sensor(), table, one, bias_drift=False, table="exact", readback_sd=READBACK
    )


def ours(table: Turntable, one: Track) -> Array:
    """Return the twelve coefficients, biases first, then S row after row."""
    made = gyro_filter(table, one)
    state, _ = made.step(made.start(one), one)
    return columns(made.triad.sensor.coefficients) @ state.theta


def peer(table: Turntable, one: Track) -> Array:
    """Return the same by filterpy."""
    earth = turntable.EARTH * np.array([0.0, np.cos(table.latitude), np.sin(table.latitude)])
    rates, dt = one.reading[:, 3:], 1 / HZ
    bias, s = rates[: round(20 * HZ) + 1].mean(axis=0) - earth, np.zeros((3, 3))
    kf = KalmanFilter(dim_x=15, dim_z=3)
    kf.P = np.diag([60 * ARCSEC] * 3 + [radians(1)] * 3 + [0.02] * 9) ** 2
    kf.R, kf.H = READBACK**2 * np.eye(3), np.eye(3, 15)
    c, m = turntable.attitude(one.angles[0]), np.eye(3)
    rest = one.hold >= 0
    q = np.zeros((15, 15))
    q[:3, :3] = turntable.T.arw**2 * dt * np.eye(3)
    for k in range(1, len(rates)):
        w = m @ (0.5 * (rates[k] + rates[k - 1]) - bias)
        half = c @ small_rotation(w * dt / 2)
        cm = half @ m
        phi = np.eye(15)
        phi[:3, :3] -= cross(earth) * dt
        phi[:3, 3:6] = -cm * dt
        phi[:3, 6:] = -kron(cm, c.T @ earth if rest[k] else w) * dt
        c = small_rotation(-earth * dt) @ c @ small_rotation(w * dt)
        kf.predict(F=phi, Q=q)
        if k % EVERY == 0:
            kf.update(small_rotation_vector(turntable.attitude(one.angles[k]) @ c.T))
            x = kf.x.ravel()
            c, bias, s = small_rotation(x[:3]) @ c, bias + x[3:6], s + x[6:].reshape(3, 3)
            m = np.linalg.inv(np.eye(3) + s)
            kf.x = np.zeros((15, 1))
    return np.concatenate([bias, s.ravel()])


def compiled(table: Turntable, one: Track) -> Callable[[], Array]:
    """Return a function that finds the same by C++."""
    code = library(CODE)
    assert code is not None
    earth = turntable.EARTH * np.array([0.0, np.cos(table.latitude), np.sin(table.latitude)])
    rates = np.ascontiguousarray(one.reading[:, 3:])
    rest = np.ascontiguousarray(one.hold >= 0, dtype=np.uint8)
    readback = np.array([turntable.attitude(angles) for angles in one.angles[::EVERY]])
    start = np.array([60 * ARCSEC] * 3 + [radians(1)] * 3 + [0.02] * 9 + [0.0] * 3)
    time = np.ascontiguousarray(one.time)
    bias = rates[: round(20 * HZ) + 1].mean(axis=0) - earth
    found = np.zeros(12)

    def run() -> Array:
        found[:3] = bias
        code.run_filter(
            ctypes.c_long(len(rates)), pointer(time), pointer(rates), pointer(rest),
            pointer(readback), ctypes.c_long(EVERY), pointer(earth), ctypes.c_double(READBACK),
            ctypes.c_double(turntable.T.arw), pointer(start), pointer(found),
        )  # fmt: skip
        return found

    return run


def against_compiled(table: Turntable, short: Track) -> Row | Skipped:
    """Compare with C++ what a sample beyond one length takes: setting up is not in it."""
    name = "gyro filter of 18 states at 200 Hz, a sample"
    if library(CODE) is None:
        return Skipped(f"{name}, C++", "no compiler")
    drawn = turntable.draw(1, 1, [*SHORT, *SHORT[1:]], table=turntable.Table(latency=0.0), hz=HZ)
    long = track(drawn).trial(0)
    times: list[tuple[float, float]] = []
    for one in (short, long):
        made, limit = gyro_filter(table, one), compiled(table, one)
        state, _ = made.step(made.start(one), one)
        value = columns(made.triad.sensor.coefficients) @ state.theta
        assert np.allclose(value, limit(), rtol=0, atol=2e-5), value - limit()
        own = best(lambda made=made, one=one: made.step(made.start(one), one))
        times.append((own, best(limit)))
    mine, theirs = np.diff(times, axis=0)[0] * 1e9 / (long.time.size - short.time.size)
    return Row(name, mine, theirs, "C++", "ns", to_reach=1 / 3)


def live_share(one: Track) -> float:
    """Return the share of a core of both filters that follow samples as they come, %."""
    duration = float(one.time[-1])
    drifting = sensor(flicker=True)
    filters = FilterPair(drifting, bench(), FILTER_CONFIGS["full"], [], duration)
    n, first = one.time.size, round(25 * HZ)
    filters.feed(one.slice(0, first))
    pieces = [one.slice(i, i + LIVE_PIECE) for i in range(first, n - LIVE_PIECE, LIVE_PIECE)]
    begin = process_time()
    for piece in pieces:
        filters.feed(piece)
        filters.estimate()
    return 100 * (process_time() - begin) * HZ / (LIVE_PIECE * len(pieces))


def rows() -> list[Row | Skipped]:
    """Compare the answers, then the times."""
    still = turntable.Table(latency=0.0)
    table = bench(still)
    short = track(turntable.draw(1, 1, SHORT, table=still, hz=HZ)).trial(0)
    mine, theirs = ours(table, short), peer(table, short)
    assert np.allclose(mine, theirs, rtol=0, atol=2e-5), mine - theirs
    n = short.time.size
    name = f"gyro filter of 18 states, {short.time[-1]:.0f} s at 200 Hz ({n} samples)"
    peers = best(lambda: peer(table, short), repeat=1)
    own = best(lambda: ours(table, short))
    found: list[Row | Skipped] = [
        Row(name, own, peers, "filterpy, 15 states", to_reach=120.0),
        against_compiled(table, short),
    ]
    long = track(turntable.draw(1, 1, LONG, hz=HZ)).trial(0)
    gyros = GyroFilter.from_track(sensor(), bench(), long, table="exact")
    others = AccelerometerFilter.from_track(sensor(), bench(), long, table="lean")

    def both() -> None:
        gyros.step(gyros.start(long), long)
        others.step(others.start(long), long)

    minutes = long.time[-1] / 60
    text = f"filters of 19 and 25 states, {minutes:.1f} min at 200 Hz"
    share = min(live_share(short) for _ in range(3))
    return [
        *found,
        Row(text, best(both), LIMIT * minutes / 30, "limit"),
        Row("both filters live, each 20 ms, of a core", share, LIVE_LIMIT, "limit", "%"),
    ]

"""A hand-held IMU, from the recording in memory to an estimate: a public one of an Xsens MTi.

The peer is the algorithm of Tedaldi, Pretto, Menegatti, ICRA 2014, 3042–3049, written down from its
equations with NumPy and SciPy: static where the variance over a second stays below a multiple of
that of the first 50 s, the multiple with the least residual among 2 to 10; accelerometers from the
norms of the static means,

    f = T K (y + b),   T = [1, −α_yz, α_zy; 0, 1, −α_zx; 0, 0, 1],   ‖f‖ = g;

gyros by the rotations between them, ω = T K (y − b) with six angles in T and b their mean in the
first 50 s, and q̇ = Ω(ω) q / 2 by Runge and Kutta's fourth order from sample to sample. Derivatives
are numeric. One peer integrates one transition after the other, the other all of them side by side.
Ours also finds the threshold, the noise, excess scatter and uncertainties, which the peers do not.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.optimize import least_squares

from benchmarks import DATA, ROOT, Row, Skipped, best
from inercal.physics.motion import Motion
from inercal.pipeline import load_recording
from inercal.recordings import Recording
from inercal.recordings.segments import (
    average_sections,
    find_rests,
    holds_from_marks,
    transitions_between_rests,
    valid_marks,
)
from inercal.runfile import Run, read

Array = NDArray[np.float64]
Ways = list[tuple[int, int]]
FOLDER = "xsens_mti_multiposition"
LIMIT = 0.2  # s
SAME = 3e-3  # of a scale: what frames, thresholds and weights make of a gyro's
FIRST, WINDOW = 50.0, 1.0  # s
MULTIPLES = range(2, 11)


def load() -> tuple[Run, Recording]:
    """Return the example's run and its recording, wherever the data are."""
    text = (ROOT / "examples" / "hand_held" / "xsens.toml").read_text(encoding="utf-8")
    with TemporaryDirectory() as folder:
        path = Path(folder) / "xsens.toml"
        path.write_text(text.replace("../../../shared/data", DATA.as_posix()), encoding="utf-8")
        run = read(path)
        return run, load_recording(run)


def ours(run: Run, recording: Recording) -> Array:
    """Return the scale of each axis, (6,), of its nominal one."""
    sensor = run.sensor
    marks, _ = valid_marks(recording, sensor, find_rests(recording, sensor).marks)
    seen = average_sections(recording, sensor, marks, holds_from_marks(marks), by_hand=True)
    seen = replace(seen, transitions=transitions_between_rests(recording, sensor, marks))
    estimate = run.method.estimator(run.estimator)(seen, sensor, run.bench, run.steps, run.priors)
    assert estimate.converged
    still, c = Motion(np.zeros((1, 3))), estimate.value[: len(sensor.coefficients)]
    slope = sensor.slope(still, c)[0]
    return np.linalg.norm(np.concatenate([slope[:3, :3], slope[3:, 3:]]), axis=1)


def peer(time: Array, y: Array, g: float, carry: Callable[..., Array]) -> Array:
    """Return the scale of each axis, (6,), from nominal readings (n, 6) in SI.

    The length of an input axis' row of the forward matrix: it is the same in all frames.
    """
    rate = 1 / float(np.median(np.diff(time)))
    first, window = round(FIRST * rate), round(WINDOW * rate)
    spread = np.linalg.norm(moving_variance(y[:, :3], window), axis=1)
    quiet = float(np.linalg.norm(y[:first, :3].var(axis=0)))
    fits: list[tuple[float, Array, Ways]] = []
    for multiple in MULTIPLES:
        rests = runs(spread < multiple * quiet, window)
        means = np.array([y[a:b, :3].mean(axis=0) for a, b in rests])
        fit = least_squares(partial(off_gravity, means=means, g=g), np.zeros(9), method="lm")
        fits.append((fit.cost / len(rests), fit.x, rests))
    _, x, rests = min(fits, key=lambda fit: fit[0])
    up = np.array([sensed_motion(x, y[a:b, :3].mean(axis=0)) for a, b in rests])
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    ways = [(before[1] - 1, after[0]) for before, after in pairwise(rests)]
    rates = y[:, 3:] - y[:first, 3:].mean(axis=0)

    def off_turns(x: Array) -> Array:
        arrived = carry(time, rates @ full(x).T, ways, up[:-1])
        return (up[1:] - arrived).ravel()

    turns: Any = least_squares(off_turns, np.zeros(9), method="lm")
    forward = np.linalg.inv(upper(x)), np.linalg.inv(full(turns.x))
    return np.linalg.norm(np.concatenate(forward), axis=1)


def moving_variance(y: Array, window: int) -> Array:
    """Return the variance over a window centred on each sample, (n, k)."""
    off = y - y.mean(axis=0)
    mean = uniform_filter1d(off, window, axis=0)
    return uniform_filter1d(off**2, window, axis=0) - mean**2


def runs(mask: NDArray[np.bool_], shortest: int) -> Ways:
    """Return half-open ranges of True of some length."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(np.int8))).reshape(-1, 2)
    return [(a, b) for a, b in edges.tolist() if b - a >= shortest]


def upper(x: Array) -> Array:
    """Return T K of the accelerometers."""
    yz, zy, zx = x[:3]
    return np.array([[1, -yz, zy], [0, 1, -zx], [0, 0, 1]]) * (1 + x[3:6])


def full(x: Array) -> Array:
    """Return T K of the gyros."""
    yz, zy, xz, zx, xy, yx = x[:6]
    return np.array([[1, -yz, zy], [xz, 1, -zx], [-xy, yx, 1]]) * (1 + x[6:9])


def sensed_motion(x: Array, y: Array) -> Array:
    return (y + x[6:9]) @ upper(x).T


def off_gravity(x: Array, means: Array, g: float) -> Array:
    return np.linalg.norm(sensed_motion(x, means), axis=1) - g


def one_by_one(time: Array, rates: Array, ways: Ways, up: Array) -> Array:
    """Return where gravity's direction is at the end of each transition, (k, 3)."""
    whole, middle = derivatives(rates)
    arrived = np.empty_like(up)
    for k, (start, stop) in enumerate(ways):
        q = np.array([1.0, 0.0, 0.0, 0.0])
        for i in range(start, stop):
            h = time[i + 1] - time[i]
            k1 = whole[i] @ q
            k2 = middle[i] @ (q + h / 2 * k1)
            k3 = middle[i] @ (q + h / 2 * k2)
            k4 = whole[i + 1] @ (q + h * k3)
            q = q + h / 6 * (k1 + 2 * (k2 + k3) + k4)
            q /= np.sqrt(q @ q)
        arrived[k] = turned_back(q[None], up[k : k + 1])[0]
    return arrived


def side_by_side(time: Array, rates: Array, ways: Ways, up: Array) -> Array:
    """Do the same for all transitions at once; those that have ended stand still."""
    whole, middle = derivatives(rates)
    start, stop = np.array(ways).T
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(ways), 1))
    for step in range(int((stop - start).max())):
        i = np.minimum(start + step, stop - 1)
        h = np.where(start + step < stop, time[i + 1] - time[i], 0.0)[:, None]
        k1 = (whole[i] @ q[..., None])[..., 0]
        k2 = (middle[i] @ (q + h / 2 * k1)[..., None])[..., 0]
        k3 = (middle[i] @ (q + h / 2 * k2)[..., None])[..., 0]
        k4 = (whole[i + 1] @ (q + h * k3)[..., None])[..., 0]
        q = q + h / 6 * (k1 + 2 * (k2 + k3) + k4)
        q /= np.sqrt((q**2).sum(axis=1, keepdims=True))
    return turned_back(q, up)


def derivatives(rates: Array) -> tuple[Array, Array]:
    """Return Ω(ω) / 2 at each sample, (n, 4, 4), and half-way to the next, (n − 1, 4, 4)."""
    x, y, z = rates.T / 2
    o = np.zeros_like(x)
    rows = [[o, -x, -y, -z], [x, o, z, -y], [y, -z, o, x], [z, y, -x, o]]
    whole = np.moveaxis(np.array(rows), -1, 0).copy()
    return whole, (whole[1:] + whole[:-1]) / 2


def turned_back(q: Array, v: Array) -> Array:
    """Return v, (k, 3), turned by the inverses of q, (k, 4)."""
    w, u = q[:, :1], -q[:, 1:]
    twice = 2 * np.cross(u, v)
    return v + w * twice + np.cross(u, twice)


def rows() -> list[Row | Skipped]:
    """Compare the scales, then the times."""
    name = "hand-held IMU (Xsens MTi), recording to estimate"
    if not (DATA / FOLDER).is_dir():
        return [Skipped(name, f"no {FOLDER} in {DATA}; set INERCAL_DATA to its folder")]
    run, recording = load()
    y, g = run.sensor.to_si(recording.data), run.bench.gravity.value
    peers = {"one transition after another": one_by_one, "transitions side by side": side_by_side}
    work = {name: partial(peer, recording.time, y, g, carry) for name, carry in peers.items()}
    scales = ours(run, recording)
    for other in work.values():
        np.testing.assert_allclose(other(), scales, rtol=SAME)
    own = best(partial(ours, run, recording), 20)
    times = {name: best(other, 2) for name, other in work.items()}
    compared = [Row(name, own, times[other], f"NumPy, SciPy, {other}") for other in times]
    return [*compared, Row(f"{name}, after warm-up", own, LIMIT, "limit")]

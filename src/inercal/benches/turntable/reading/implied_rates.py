"""Compute the rates from a turntable's readback and from the gyros, and the delay between them.

Both rates are means over the same short window, from the integrated gyro readings and from
differences of the readback, so that the effect of the window cancels. With the readings w and the
readback's rate v, which is delayed by δ::

    w(t) = A v(t + δ) + b   ⇒   δ ≈ Σ (A v̇) · (w − A v − b) / Σ |A v̇|²

summed over a stretch in which the rate changes. A and b approximate bias, scale and misalignment
and are fitted over the whole run. If δ is positive, the readback shows at t + δ the motion that the
gyros show at t.

Before filtering, the earth's rate that the gyros measure is compared with latitude and azimuth. In
hold k with the attitude C_k, and with scale and misalignment from the turns, the gyros read::

    w_k = b + C_kᵀ e + G C_kᵀ u        u up; G only if the method estimates it

The biases b and the earth's rate e, in the level frame with the stated azimuth, are estimated by
weighted least squares. Drift that exceeds the stated noise appears in the residuals and enlarges
the covariance. An azimuth error δ rotates e by δ about the vertical.
"""

from math import atan2, degrees, hypot, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.benches.turntable.attitude import (
    body_rates,
    earth_rate_level_frame,
    reference_attitude,
)
from inercal.benches.turntable.bench import Turntable
from inercal.physics.earth import EARTH_RATE
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import GAP_FACTOR, Finding, Track

_HALF = 0.02  # s, half a window
_CHANGING = 0.1  # times the largest change of rate
_NEAR = 0.1  # s: stretches that are closer together are joined
_FEWEST = 3  # samples in a stretch
_BLOCK = 1 << 16  # samples


class WindowedRates(NamedTuple):
    """Means over windows of the time, s, the rate, rad/s, and its derivative, rad/s²."""

    time: Array  # (n,)
    rate: Array  # (n, 3)
    change: Array  # (n, 3)
    is_complete: NDArray[np.bool_]  # (n,) whether each window is without a gap


def half_window(time: Array) -> int:
    """Return half the length of a window in samples."""
    return max(round(_HALF / float(np.median(np.diff(time)))), 1)


def table_rates(bench: Turntable, time: Array, angles: Array) -> WindowedRates:
    """Return the angular rate of the body that the readback implies.

    Parameters
    ----------
    bench : Turntable
    time : (n,) array
        Times, s.
    angles : (n, k) array
        Readback of the axes, rad.
    """
    h = half_window(time)
    return _differentiate_rates(time, _mean_table_rates(bench, time, angles, h), h)


def rate_vectors(sensor: Sensor, reading: Array) -> Array:
    """Return the rates that gyros in three directions or more measure, (n, 3) rad/s.

    Parameters
    ----------
    sensor : Sensor
    reading : (n, m) array
        Readings of the sensor's axes, SI.
    """
    gyros = [axis.measures == "w" for axis in sensor.axes]
    return np.asarray(reading[:, gyros] @ np.linalg.pinv(sensor.input_axes("w")).T, dtype=float)


def gyro_rates(time: Array, reading: Array) -> WindowedRates:
    """Return the gyros' readings, (n, 3) rad/s, averaged over the same windows."""
    h = half_window(time)
    return _differentiate_rates(time, _mean_gyro_rates(time, reading, h), h)


def _mean_table_rates(bench: Turntable, time: Array, angles: Array, h: int) -> Array:
    turned = (angles[2 * h :] - angles[: -2 * h]) / (time[2 * h :] - time[: -2 * h])[:, None]
    return body_rates(bench, angles[h:-h], turned)


def _mean_gyro_rates(time: Array, reading: Array, h: int) -> Array:
    part = np.diff(time)[:, None] * (reading[1:] + reading[:-1]) / 2
    whole = np.zeros(reading.shape)
    np.cumsum(part, axis=0, out=whole[1:])
    return (whole[2 * h :] - whole[: -2 * h]) / (time[2 * h :] - time[: -2 * h])[:, None]


def _differentiate_rates(time: Array, rate: Array, h: int) -> WindowedRates:
    middle, step = time[h:-h], float(np.median(np.diff(time)))
    change = np.zeros_like(rate)
    spans = (middle[2 * h :] - middle[: -2 * h])[:, None]
    change[h:-h] = (rate[2 * h :] - rate[: -2 * h]) / spans
    clean = np.ones(middle.size, np.bool_)
    for k in np.flatnonzero(np.diff(time) > GAP_FACTOR * step):
        clean[max(k - 3 * h, 0) : k + h + 1] = False
    return WindowedRates(middle, rate, change, clean)


class RateRegression(NamedTuple):
    """A linear model: readings are `matrix` @ rate + `bias` with residuals of `sd` rad/s."""

    matrix: Array
    bias: Array
    sd: float

    def residual_rates(self, reading: Array, rate: Array) -> Array:
        """Return the readings (n, 3) minus the readings predicted for a rate (n, 3)."""
        return reading - rate @ self.matrix.T - self.bias


def fit_rates(reading: Array, rate: Array) -> RateRegression:
    """Return the least-squares regression of readings (n, 3) on a rate (n, 3)."""
    means = reading.mean(axis=0), rate.mean(axis=0)
    y, p = reading - means[0], rate - means[1]
    back = np.asarray(np.linalg.pinv(p.T @ p, rcond=1e-6, hermitian=True), dtype=float)
    matrix = np.asarray((y.T @ p) @ back, dtype=float)
    bias = np.asarray(means[0] - matrix @ means[1], dtype=float)
    return RateRegression(matrix, bias, float(np.std(y - p @ matrix.T)))


def fit_track_rates(bench: Turntable, track: Track, sensor: Sensor) -> RateRegression:
    """Apply `fit_rates` to the windowed rates of a track, block by block to save memory.

    Parameters
    ----------
    bench : Turntable
    track : Track
        Track of one trial, (n, m) readings.
    sensor : Sensor
        Sensor whose gyros measure all components.
    """
    h, n = half_window(track.time), track.time.size
    total, squares = np.zeros(6), np.zeros((6, 6))
    for start in range(0, n - 2 * h, _BLOCK):
        # The windows of a part continue those of the last part.
        part = track.slice(start, start + _BLOCK + 2 * h)
        gyros = _mean_gyro_rates(part.time, rate_vectors(sensor, part.reading), h)
        table = _mean_table_rates(bench, part.time, part.angles, h)
        both = np.concatenate([gyros, table], axis=1)
        total += both.sum(axis=0)
        squares += both.T @ both
    mean = total / (n - 2 * h)
    squares = squares / (n - 2 * h) - np.outer(mean, mean)
    back = np.asarray(np.linalg.pinv(squares[3:, 3:], rcond=1e-6, hermitian=True), dtype=float)
    matrix = np.asarray(squares[:3, 3:] @ back, dtype=float)
    left = np.trace(squares[:3, :3] - matrix @ squares[3:, :3])
    bias = np.asarray(mean[:3] - matrix @ mean[3:], dtype=float)
    return RateRegression(matrix, bias, float(np.sqrt(max(left, 0.0) / 3)))


class LocalOffsets(NamedTuple):
    """Delay of the readback in each stretch in which the rate changes."""

    time: Array  # (e,) s, in the middle of each stretch
    value: Array  # (e,) s
    sd: Array  # (e,) s
    spans: NDArray[np.int64]  # (e, 2) first and last sample of each


def local_offsets(table: WindowedRates, residual: Array, known: RateRegression) -> LocalOffsets:
    """Return the local offsets with their standard deviations.

    Parameters
    ----------
    table : WindowedRates
        Rates from the readback.
    residual : (n, 3) array
        Residuals of the gyros' rates at the same times, rad/s (`RateRegression.residual_rates`).
    known : RateRegression
    """
    spans = _changing_stretches(table)
    h = half_window(table.time)
    # Because windows overlap, this many neighbouring residuals count as one independent residual.
    overlap, least = 2.0 * h + 1, float(np.median(np.abs(residual))) ** 2
    value, sd = np.zeros(len(spans)), np.zeros(len(spans))
    for k, (first, last) in enumerate(spans):
        a, r = table.change[first : last + 1] @ known.matrix.T, residual[first : last + 1]
        weight = np.sum(a**2)
        value[k] = np.sum(a * r) / weight
        noise = float(np.sum((r - value[k] * a) ** 2)) / r.size
        sd[k] = np.sqrt(overlap * max(noise, least) / weight)
    return LocalOffsets(table.time[spans].mean(axis=1), value, sd, spans)


def _changing_stretches(table: WindowedRates) -> NDArray[np.int64]:
    """Return the first and last sample of each stretch without a gap in which the rate changes."""
    size = np.linalg.norm(table.change, axis=-1)
    step = float(np.median(np.diff(table.time)))
    at = np.flatnonzero(size > _CHANGING * np.percentile(size, 99.9))
    if not at.size:
        return np.zeros((0, 2), np.int64)
    cut = np.flatnonzero(np.diff(at) > max(_NEAR / step, 1.5))
    first = np.concatenate([at[:1], at[cut + 1]])
    last = np.concatenate([at[cut], at[-1:]])
    found = np.stack([first, last], axis=-1)
    clean = [
        last - first >= _FEWEST and table.is_complete[first : last + 1].all()
        for first, last in found
    ]
    return found[np.array(clean, dtype=np.bool_)]


_AXES = 3
_CLEAR, _ODD = 100.0, 30.0  # χ² of three components
_FAR = 0.3  # times the earth's rate: smaller errors have little effect
_NEAR_UNIT = 0.2
_G_SENSITIVITY = np.radians(20) / 3600 / G0  # standard deviation of G, (rad/s)/(m/s²)


def check_earth_rate(
    where: str, track: Track, sensor: Sensor, bench: Turntable, known: RateRegression | None
) -> tuple[Finding, ...]:
    """Return a warning if the gyros measure a different earth rate than the stated one.

    Parameters
    ----------
    where : str
        Start of error messages.
    track : Track
        Track of one trial, (n, m) readings.
    sensor : Sensor
    bench : Turntable
    known : RateRegression or None
        Result of `fit_track_rates` for the track; None if the gyros do not measure all components,
        in which case nothing is checked.

    Raises
    ------
    InputError
        The measured rate has the size of the earth's rate, but belongs to another azimuth or
        latitude.
    """
    if known is None:
        return ()
    if (result := _measured_earth_rate(track, sensor, bench, known)) is None:
        return ()
    measured, covariance = result
    stated = earth_rate_level_frame(bench)
    # The uncertainty of the stated azimuth rotates the horizontal part.
    azimuth_error = np.array([stated[1], 0.0, 0.0]) * bench.azimuth.sd
    off = measured - stated
    total = covariance + np.outer(azimuth_error, azimuth_error)
    chi2 = float(off @ np.linalg.solve(total, off))
    if chi2 < _ODD or np.linalg.norm(off) < _FAR * EARTH_RATE:
        return ()
    sd = np.sqrt(np.diagonal(covariance))
    text = ", ".join(
        f"{degrees(x) * 3600:.1f} ± {2 * degrees(s) * 3600:.1f} °/h {name} "
        f"[{degrees(e) * 3600:.1f}]"
        for name, x, s, e in zip(("east", "north", "up"), measured, sd, stated, strict=True)
    )
    text = f"in the holds the gyros measure an earth rate (k = 2) [stated] of {text}"
    if chi2 > _CLEAR and abs(float(np.linalg.norm(measured)) / EARTH_RATE - 1) < _FAR:
        text += f"; {_describe_implied_place(measured, bench)}; check both in [bench] (south is "
        text += "negative), and the zero of the outer axis' readback"
        raise InputError(
            f"{where}: {text.replace('-', '−')}", names=("[bench] azimuth", "[bench] latitude")
        )
    text += "; check [bench] latitude and azimuth, drift beyond the gyros' bias_instability, and "
    text += "g sensitivity"
    return (Finding("warning", "earth", text.replace("-", "−")),)


def _describe_implied_place(rate: Array, bench: Turntable) -> str:
    """Describe the azimuth and latitude implied by an earth rate, (3,) rad/s in the level frame."""
    east, north, up = rate.tolist()
    azimuth = bench.azimuth.value + atan2(-east, north)
    azimuth = degrees(pi - (pi - azimuth) % (2 * pi))
    latitude = degrees(atan2(up, hypot(east, north)))
    return (
        f"it implies azimuth {azimuth:.0f}° and latitude {latitude:.0f}°, not the stated "
        f"{degrees(bench.azimuth.value):.3g}° and {degrees(bench.latitude):.3g}°"
    )


def _measured_earth_rate(
    track: Track, sensor: Sensor, bench: Turntable, known: RateRegression
) -> tuple[Array, Array] | None:
    """Return the earth's rate in the level frame and its covariance, or None if not observable."""
    number = track.hold + 1  # 0 while the table moves
    count = np.bincount(number)[1:]
    if count.size < _AXES or not count.all():
        return None
    sums = [np.bincount(number, column)[1:] for column in track.reading.T]
    mean = rate_vectors(sensor, np.stack(sums, axis=-1) / count[:, None])
    middles = [int(np.median(np.flatnonzero(track.hold == k))) for k in range(count.size)]
    back = np.swapaxes(reference_attitude(bench, track.angles[middles]), -1, -2)
    if np.abs(known.matrix - np.eye(_AXES)).max() < _NEAR_UNIT:
        mean = mean @ np.linalg.inv(known.matrix).T
    noise = [axis.noise for axis in sensor.axes if axis.measures == "w"]
    white = float(np.mean([one.white**2 for one in noise]))
    drift = float(np.mean([one.bias_instability**2 for one in noise]))
    seconds = count * float(np.median(np.diff(track.time)))
    sd = np.sqrt(white / seconds + drift)
    if not sd.all():
        return None
    design = np.concatenate([np.broadcast_to(np.eye(3), back.shape), back], axis=-1)
    if any(axis.measures == "w" and _has_g_sensitivity(sensor, axis.name) for axis in sensor.axes):
        up = back[:, :, 2] * bench.gravity.value
        design = np.concatenate([design, np.kron(np.eye(3), up[:, None, :])], axis=-1)
    rows = (design / sd[:, None, None]).reshape(-1, design.shape[-1])
    wanted = (mean / sd[:, None]).reshape(-1)
    prior = np.zeros(rows.shape[-1])
    prior[6:] = 1 / _G_SENSITIVITY**2
    # Biases have no prior; no component of the earth's rate exceeds its size.
    prior[3:6] = 1 / (3 * EARTH_RATE) ** 2
    covariance = np.linalg.inv(rows.T @ rows + np.diag(prior))
    x = np.asarray(covariance @ (rows.T @ wanted), dtype=float)
    freedom = rows.shape[0] - 6
    excess = float(np.sum((wanted - rows @ x) ** 2)) / max(freedom, 1)
    return x[3:6], np.asarray(covariance[3:6, 3:6] * max(excess, 1.0), dtype=float)


def _has_g_sensitivity(sensor: Sensor, axis: str) -> bool:
    return any(
        name.startswith(f"{axis}.") and sensor.coefficient(name).group == "g"
        for name in sensor.coefficients
    )

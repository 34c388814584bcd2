"""Compare the earth's rate that the gyros measure with latitude and azimuth, before filtering.

In hold k with the attitude C_k, and with scale and misalignment from the turns, the gyros read::

    w_k = b + C_kᵀ e + G C_kᵀ u        u up; G only if the method estimates it

The biases b and the earth's rate e, in the level frame with the stated azimuth, are estimated by
weighted least squares. Drift that exceeds the stated noise appears in the residuals and enlarges
the covariance. An azimuth error δ rotates e by δ about the vertical.
"""

from math import atan2, degrees, hypot, pi

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.benches.turntable.attitude import earth_rate_level_frame, reference_attitude
from inercal.benches.turntable.bench import Turntable
from inercal.benches.turntable.reading.implied_rates import RateRegression, rate_vectors
from inercal.physics.earth import EARTH_RATE
from inercal.physics.sensors import G0, Sensor
from inercal.recordings import Finding, Track

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
    reading = rate_vectors(sensor, track.reading)
    held = track.hold >= 0
    count = np.bincount(track.hold[held])
    if count.size < _AXES or not count.all():
        return None
    mean = np.stack(
        [np.bincount(track.hold[held], axis) / count for axis in reading[held].T], axis=-1
    )
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

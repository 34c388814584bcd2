"""Guess the unit, scale factor and offset of each triad from gravity and turns between rests."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import format_count, si_factor
from inercal.physics.sensors import G0, output_unit
from inercal.pipeline.drafts.draft_entries import UNKNOWN
from inercal.pipeline.drafts.quiet_sections import QuietMeans
from inercal.recordings.segments.gravity_turns import (
    GravityTurns,
    describe_changes,
    find_matching_axes,
    rotations,
    sphere,
    sum_rates,
    turn_differences,
)

_ACCELEROMETER_UNITS = {"m/s²": 1.0, "g": G0, "mg": 1e-3 * G0}
_GYRO_UNITS = {"rad/s": 1.0, "°/s": np.pi / 180, "m°/s": np.pi / 180e3}
# If two differ by less than the error of any sensor, the power of two comes first.
_COUNTS_PER_G = (*(2.0**k for k in range(5, 16)), 1000.0, 1000 / 0.061, 1000 / 0.122, 1000 / 0.244)
_COUNTS_PER_DEGREE = (131.0, 65.5, 32.8, 16.4, 1 / 0.00875, 1 / 0.0175, 1 / 0.035, 1 / 0.07)
_STATED = "stated, or taken from the column names or the format"
_NO_GRAVITY = 0.08  # g; more than any usual bias, and less than g read as m/s²
FEWEST_COUNTS = 30.0  # per g
_FAR = 0.5  # of gravity; a larger bias is named
_WIDEST = 2.0  # largest radius of a sphere, relative to the range of the readings
_MID_SCALES = tuple(2.0**k for k in range(7, 32))
_NEAR = 0.12  # relative to a unit's size: bias and scale errors of a plain MEMS sensor
_NEAR_NOMINAL = 0.04  # relative to a nominal scale factor
_ANGLES = (np.deg2rad(20), np.deg2rad(160))  # between two attitudes, for a gyro's scale
_LIKELY = (10.0, 2500.0)  # Hz, likely rates of a log without times
_MOST_TURNS = 40
_SLOW = 0.05  # relative to the highest rate; below, only gravity matters
_TURN_SAMPLES = 128  # a power of two
_MOST_MISFIT = np.deg2rad(8)
_FEWEST_TURNS = 3  # marked turns: one about each axis


class GuessedReadout(NamedTuple):
    """The guessed readout of a triad: unit, scale factor and offset.

    Parameters
    ----------
    unit : str
        Unit of the readings; "LSB" if it is none of the usual units; if it is not certain, the
        usual one, or `UNKNOWN`.
    scale : str
        Nominal scale factor of counts, such as "2048 LSB/g"; empty if the readings have a unit.
    offset : float
        Reading at zero, in output units.
    size : float
        Estimated size of one output unit in SI units.
    reason : str
    certain : bool
        False if only the user can tell.
    rate_hz : float
        Sampling rate that the turns suggest; 0 if they suggest none.
    """

    unit: str
    scale: str
    offset: float
    size: float
    reason: str
    certain: bool = True
    rate_hz: float = 0.0


def guess_accelerometer(means: Array, stated: str | None) -> GuessedReadout:
    """Guess the accelerometers' readout from the size of gravity in means at rest, (k, 3).

    Raises
    ------
    InputError
        If all means are zero.
    """
    _require_gravity(means.any(), "at rest")
    centre, radius = sphere(means)
    if stated is not None and output_unit(stated) is None:
        size = si_factor(stated, "m/s²")
        largest = float(np.linalg.norm(means, axis=-1).max()) * size / G0
        if largest < _NO_GRAVITY:
            raise InputError(
                f"the accelerometers read at most {largest:.2g} g at rest, so gravity was removed "
                f"from them, or their unit is not {stated}: record the acceleration with gravity, "
                "or state --set sensor.accelerometer.unit",
                key="data.accelerometer",
            )
        return GuessedReadout(stated, "", 0.0, size, _STATED)
    plain = float(np.median(np.linalg.norm(means, axis=-1)))
    norms = [] if stated else [(plain, f"at rest the readings have a norm of {plain:.4g}")]
    if radius is not None and not stated and 3 * radius > plain:
        norms.append((radius, f"the readings at rest lie on a sphere of radius {radius:.4g}"))
    for norm, reason in norms:
        if (unit := gravity_unit(norm)) is not None:
            return GuessedReadout(unit, "", 0.0, _ACCELEROMETER_UNITS[unit], reason)
    counts = radius if radius is not None else plain
    offset = 0.0 if centre is None else _offset(float(np.median(centre)), counts)
    if counts < FEWEST_COUNTS and stated is None:
        reason = f"gravity reads {counts:.4g}, which fits none of the usual units"
        return GuessedReadout(UNKNOWN, "", 0.0, G0 / counts, reason, certain=False)
    per_g, why = _nominal(counts, _COUNTS_PER_G)
    usual = next((one for one in _COUNTS_PER_G if abs(counts / one - 1) < _NEAR), None)
    if not why and usual is not None:  # the mean of a single rest contains the bias
        per_g, why = usual, f", within {100 * _NEAR:.0f} % of the usual {usual:.6g}"
    unit = stated or "LSB"
    reason = f"gravity reads {counts:.4g} {'counts' if unit == 'LSB' else unit}{why}"
    return GuessedReadout(unit, f"{per_g:.6g} {unit}/g", offset, G0 / per_g, reason)


def _require_gravity(reads: object, when: str) -> None:
    if not reads:
        raise InputError(
            f"the accelerometers read 0 {when}: check that the sensor is connected and awake, "
            "and that the columns are right",
            key="data.accelerometer",
        )


def gravity_unit(norm: float) -> str | None:
    """Return the usual unit in which gravity has this norm; None if no unit fits."""
    near = (u for u, size in _ACCELEROMETER_UNITS.items() if abs(norm * size / G0 - 1) < _NEAR)
    return next(near, None)


def far_off(means: Array, names: Sequence[str]) -> tuple[str, ...]:
    """Return a text for each accelerometer whose bias exceeds half of gravity.

    Parameters
    ----------
    means : (k, 3) array
        Means at rest.
    names : sequence of str
        Names of the columns.
    """
    centre, radius = sphere(means)
    if centre is None or radius is None or norm_misfit(means) > _NEAR:
        return ()
    offsets = zip(names, (centre / radius).tolist(), strict=True)
    return tuple(f"{name} is off by {k:+.2f} g" for name, k in offsets if abs(k) > _FAR)


def guess_from_norms(
    force: Array, rate: Array, radius: float | None, stated: str | None
) -> tuple[GuessedReadout, float | None]:
    """Guess the accelerometers' readout and the arm's radius (in m) from norms at several rates.

    The squared norm is s² (g² + ω⁴ r²). The size s of an output unit follows from the radius or, if
    the arm is also at rest, from gravity; in that case the radius follows too.

    Parameters
    ----------
    force : (n, 3) array
        Readings.
    rate : (n,) array
        ω, rad/s.
    radius : float or None
        Radius in m, if it is known.
    stated : str or None
        Unit that the user states.
    """
    norm = np.linalg.norm(force, axis=-1)
    _require_gravity(np.median(norm), "in most rows")
    if not rate.any():
        raise InputError("the arm's rate is 0 in all rows", key="data.arm_rate")
    slow = np.abs(rate) <= _SLOW * np.abs(rate).max()
    if radius is None and not slow.any():
        text = "it follows from the radius"
        return GuessedReadout("LSB", "", 0.0, 1.0, text, certain=False), None
    if radius is None:
        plain = float(np.median(norm[slow]))
        fast = np.abs(rate) >= 0.5 * np.abs(rate).max()
        across = np.sqrt(np.maximum((norm * G0 / plain) ** 2 - G0**2, 0.0))
        radius = float(np.median(across[fast] / rate[fast] ** 2))
        reason = f"at rest the readings have a norm of {plain:.4g}"
    else:
        plain = float(np.median(norm * G0 / np.hypot(G0, rate**2 * radius)))
        reason = f"with this radius gravity is {plain:.4g}"
    return _readout_at_gravity(plain, reason, stated), radius


def guess_from_turned_axis(force: Array, stated: str | None) -> GuessedReadout:
    """Guess the readout of accelerometers, (n, k), that a head turned through gravity."""
    plain = float(np.max(np.abs(force - 0.5 * (force.max(axis=0) + force.min(axis=0)))))
    _require_gravity(plain, "or the same at all angles")
    return _readout_at_gravity(plain, f"the largest reading is {plain:.4g}", stated)


def _readout_at_gravity(plain: float, reason: str, stated: str | None) -> GuessedReadout:
    """Return the readout of accelerometers that read `plain` at gravity, in the stated unit."""
    if stated is not None and output_unit(stated) is None:
        return GuessedReadout(stated, "", 0.0, si_factor(stated, "m/s²"), _STATED)
    if stated is None and (unit := gravity_unit(plain)) is not None:
        return GuessedReadout(unit, "", 0.0, _ACCELEROMETER_UNITS[unit], reason)
    unit = stated or "LSB"
    if stated is None:
        reason += "; the unit may also be V or mA, but is called LSB here"
    return GuessedReadout(unit, f"{plain:.4g} {unit}/g", 0.0, G0 / float(f"{plain:.4g}"), reason)


def norm_misfit(means: Array) -> float:
    """Return the relative scatter of the norms of rest readings, (k, 3), about their sphere.

    The scatter is relative to the radius. The norms are taken about the sphere's centre, or about
    zero if the attitudes do not span a sphere.
    """
    centre, radius = sphere(means)
    if radius is not None and radius > _WIDEST * float(np.ptp(means, axis=0).max()):
        return np.inf  # the readings lie (nearly) in a plane, so the centre is far outside
    norms = np.linalg.norm(means - (0.0 if centre is None else centre), axis=-1)
    mean = float(norms.mean())
    return float(norms.std()) / mean if mean else np.inf


def off_sphere(means: Array, data: Array) -> float:
    """Return how far readings, (n, 3), are from the sphere of the rests, relative to its radius."""
    centre, radius = sphere(means)
    if centre is None or radius is None:
        return 0.0
    return float(np.linalg.norm(data - centre, axis=-1).std()) / radius


def _offset(centre: float, reach: float) -> float:
    """Return the nominal offset of a converter: zero, half of its range, or the centre found."""
    if abs(centre) < 0.3 * reach:
        return 0.0
    near = min(_MID_SCALES, key=lambda one: abs(np.log(max(centre, 1.0) / one)))
    return near if abs(centre - near) < 0.3 * reach else float(f"{centre:.3g}")


def _nominal(counts: float, known: Sequence[float]) -> tuple[float, str]:
    """Return the first known scale factor that is near, and a text with all that are near."""
    near = [one for one in known if abs(counts / one - 1) < _NEAR_NOMINAL]
    if near:
        others = " and ".join(f"{one:.6g}" for one in near[1:])
        more = f"; {others} would also fit" if others else ""
        return near[0], f", close to the usual {near[0]:.6g}{more}"
    return float(f"{counts:.3g}"), ""


def counts_per_degree(counts: float) -> tuple[float, str]:
    """Return the usual scale of gyros near `counts` LSB/(°/s), or these counts, with a reason."""
    return _nominal(counts, _COUNTS_PER_DEGREE)


def guess_gyro(
    rests: QuietMeans,
    gyro: Array,
    accelerometer: GuessedReadout,
    dt: float | None,
    stated: str | None,
    turns: Sequence[tuple[int, int]] = (),
) -> GuessedReadout:
    """Guess the gyros' readout from the angles by which gravity turned between rests.

    Parameters
    ----------
    rests : QuietMeans
    gyro : (n, 3) array
        Readings.
    accelerometer : GuessedReadout
    dt : float or None
        Time between samples, s; None if it is unknown.
    stated : str or None
        Unit in the columns' names.
    turns : sequence of (start, stop)
        Start and stop samples of the marked sections with motion.
    """
    assert rests.rate is not None
    offset = 0.0 if gyro.min() < 0 else _gyro_offset(rests)  # only unsigned counts have one
    if stated is not None and output_unit(stated) is None:
        return GuessedReadout(stated, "", 0.0, si_factor(stated, "rad/s"), _STATED)
    size, count, misfit = gyro_scale(rests, gyro, accelerometer.offset)
    turned = format_count(count, "turn between rests agrees", "turns between rests agree")
    reason = f"{turned} with gravity within {np.degrees(misfit):.1f}°"
    if size is None and len(turns) >= _FEWEST_TURNS:
        bias = np.median(rests.rate, axis=0)
        swept = [np.linalg.norm((gyro[a:b] - bias).sum(axis=0)) for a, b in turns]
        size = 2 * np.pi / float(np.median(swept))
        reason = f"{format_count(len(turns), 'marked turn')}, each taken as 360°"
    whole = bool(np.all(gyro == np.rint(gyro)))  # counts, whose scale needs the rate
    if stated is not None and (size is None or dt is None):
        why = "only you can state the scale" if size is None else "the scale needs the rate"
        return GuessedReadout(stated, UNKNOWN, offset, np.pi / 180, why)
    if size is not None and dt is None and not whole:
        rates = {unit: si / size for unit, si in _GYRO_UNITS.items()}
        likely = [unit for unit, rate in rates.items() if _LIKELY[0] < rate < _LIKELY[1]]
        if len(likely) == 1:
            (unit,) = likely
            text = (
                f"{reason} at about {rates[unit]:.3g} Hz; another unit would need an unlikely rate"
            )
            return GuessedReadout(unit, "", 0.0, _GYRO_UNITS[unit], text, rate_hz=rates[unit])
    if size is None or dt is None:
        known_with = "inercal init finds it if you state the rate with --set data.rate"
        unknown = known_with if size is not None else "no turn between rests determines it"
        if size is None and whole:
            unknown += "; for raw counts use LSB and a sensor.gyro.scale such as 131 LSB/(°/s)"
        unit = UNKNOWN if whole or size is not None else "°/s"
        return GuessedReadout(unit, "", offset, np.pi / 180, unknown, False)
    size /= dt
    for unit, si in _GYRO_UNITS.items():
        if stated is None and abs(size / si - 1) < _NEAR:
            return GuessedReadout(unit, "", 0.0, si, reason)
    per_degree, why = counts_per_degree(np.pi / 180 / size)
    unit = stated or "LSB"
    text = f"{per_degree:.6g} {unit}/(°/s)"
    return GuessedReadout(unit, text, offset, np.pi / 180 / per_degree, reason + why)


def guess_resting_gyro(stated: str | None) -> GuessedReadout:
    """Return the readout of gyros that never turn, from the stated unit if there is one."""
    why = "a sensor at rest does not show it; for raw counts use LSB and a sensor.gyro.scale"
    if stated is None:
        return GuessedReadout("°/s", "", 0.0, np.pi / 180, why, certain=False)
    if output_unit(stated) is not None:
        return GuessedReadout(stated, UNKNOWN, 0.0, np.pi / 180, "only you can state the scale")
    return GuessedReadout(stated, "", 0.0, si_factor(stated, "rad/s"), _STATED)


def _gyro_offset(rests: QuietMeans) -> float:
    assert rests.rate is not None
    centre = float(np.median(rests.rate))
    near = min(_MID_SCALES, key=lambda one: abs(np.log(max(centre, 1.0) / one)))
    return near if centre > 100 and abs(centre / near - 1) < 0.05 else 0.0


def gyro_scale(rests: QuietMeans, gyro: Array, offset: float) -> tuple[float | None, int, float]:
    """Estimate the angle of one count during one sample, rad, with number of turns and misfit.

    The angle by which gravity turns relative to the case between two rests must follow from the
    gyros: f₂ = Rᵀ(s) f₁, where R is the product of the rotations s·ω of all samples. The misfit is
    in rad.
    """
    turns = turns_of_readings(rests, gyro, offset)
    if turns is None:
        return None, 0, 0.0
    first, second, swept = turns

    def best(scales: Array, angles: Array) -> tuple[int, float]:
        turned = (turn_differences(first, second, rotations(k * angles)) for k in scales)
        misfits = [float(np.median(one)) for one in turned]
        return int(np.argmin(misfits)), min(misfits)

    grid = _likely_scales(swept, 240)
    # A quarter of the steps tells where the scale is, in a quarter of the time.
    k, _ = best(grid, swept.reshape(len(swept), -1, 4, 3).sum(axis=2))
    low, high = float(grid[max(k - 1, 0)]), float(grid[min(k + 1, len(grid) - 1)])
    near = np.geomspace(low, high, 25)
    k, misfit = best(near, swept)
    return (None, 0, 0.0) if misfit > _MOST_MISFIT else (float(near[k]), len(swept), misfit)


def turns_of_readings(rests: QuietMeans, gyro: Array, offset: float) -> GravityTurns | None:
    """Return the large turns of gravity between rests, with angles in counts times samples.

    Fewer than three accelerometers do not show them.
    """
    if rests.force.shape[1] != gyro.shape[1]:
        return None
    centre, _ = sphere(rests.force)
    force = rests.force - (offset if centre is None else centre)
    unit = force / np.linalg.norm(force, axis=-1, keepdims=True)
    assert rests.rate is not None
    middles = rests.spans.mean(axis=1).astype(int)
    between = np.arccos(np.clip((unit[:-1] * unit[1:]).sum(axis=-1), -1, 1))
    chosen = np.flatnonzero((between > _ANGLES[0]) & (between < _ANGLES[1]))
    if not chosen.size:
        return None
    chosen = chosen[:: -(-len(chosen) // _MOST_TURNS)]
    bias = 0.5 * (rests.rate[chosen] + rests.rate[chosen + 1])
    swept = [
        sum_rates(gyro[middles[k] : middles[k + 1]] - b, _TURN_SAMPLES)
        for k, b in zip(chosen, bias, strict=True)
    ]
    return GravityTurns(unit[chosen], unit[chosen + 1], np.stack(swept))


def _likely_scales(swept: Array, count: int) -> Array:
    """Return trial scales, from one that is far too small to one that is far too large."""
    typical = float(np.median(np.linalg.norm(np.abs(swept).sum(axis=1), axis=-1)))
    return np.geomspace(0.2, 8.0, count) / typical


def axis_changes(turns: GravityTurns) -> tuple[str, ...]:
    """Describe which axes to exchange or reverse so that turns agree with gravity at any scale.

    Axes are named ax to gz. The result is empty if no single change makes them agree.
    """
    if len(turns.angles) < _FEWEST_TURNS or not turns.angles.any():
        return ()
    found = find_matching_axes(turns, _likely_scales(turns.angles, 60).tolist())
    matrices = {one.matrix for one in found}
    return describe_changes(replace(found[0], factor=1.0)) if len(matrices) == 1 else ()


def white_noise(data: Array, rests: QuietMeans, size: float, dt: float) -> float:
    """Return the white noise density within rests, in SI·√s, of the noisiest axis.

    The density is computed from differences of neighbouring samples, which contain rounding but no
    slow changes.

    Parameters
    ----------
    data : (n, 3) array
        Readings.
    rests : QuietMeans
    size : float
        Size of an output unit in SI units.
    dt : float
        Time between samples, s.
    """
    inner = [data[a + (b - a) // 4 : b - (b - a) // 4] for a, b in rests.spans.tolist()]
    scatter = [np.diff(part, axis=0).std(axis=0) for part in inner if len(part) > 2]
    return float(np.median(scatter, axis=0).max()) / np.sqrt(2) * size * np.sqrt(dt)

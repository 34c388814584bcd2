"""Predict the error of the readings and the uncertainty of their correction at operating points.

At the operating point x = (f, ω, m, T) the sensor reads y = h(x, c). With the estimated
coefficients ĉ, the correction returns the x̂ that solves h(x̂, ĉ) = y. To first order, its error is
linear in the error of the coefficients, so their covariance C gives the uncertainty::

    x̂ − x = J (ĉ − c),    J = −(∂h/∂x)⁺ ∂h/∂c,    cov(x̂) = J C Jᵀ,    U = 2 u

A group of coefficients g contributes J_g C_g. Jᵀ to the variance. These contributions add up to the
variance. One of them is negative if the errors of two groups are correlated and partly cancel. An
error of the bench q that other calibrations share contributes (J P_q)²/u_q²
(`inercal.calibration.shared_errors`).

An effect that the data cannot show has a size δ at which it would shift a coefficient by 5 u
(`inercal.calibration.detectability`). Inside the validity, the estimated coefficients absorb most
of such an effect. Outside, the error of an effect with basis function φ can be as large as δ φ(x).
It is treated as uniformly distributed within ± δ φ(x), so its variance is (δ φ)²/3, independently
for each axis. U then covers each single effect up to its size δ. Only effects that depend on the
part of the point that is outside are added.

Sources: JCGM 102:2011, 6.2 (propagation); JCGM 100:2008, 4.3.7 (uniform distribution).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName
from inercal.basics.units import ZERO_CELSIUS, si_factor
from inercal.calibration import Calibration
from inercal.calibration.detectability import UndetectableCause, coefficient_definition
from inercal.calibration.validity import READING_MARGIN, TEMPERATURE_MARGIN, distance_outside
from inercal.estimation.uncertainty import COVERAGE
from inercal.physics.magnetism import heading_gradient
from inercal.physics.motion import Motion
from inercal.physics.quantities import KINDS, QUANTITIES, Measures
from inercal.physics.sensors import TABLES, Sensor, inverse
from inercal.physics.sensors.coefficient_selection import GROUP_WORDS, coefficient_words

OWN_ERRORS = "noise and errors of this run only"
SHOWN: Mapping[str, tuple[str, float]] = {
    kind: (one.reading_unit, si_factor(one.reading_unit)) for kind, one in QUANTITIES.items()
}
"""Unit in which each quantity is printed, and its size in SI units."""
# The components of the motion on which terms depend, by the part of an operating point.
_COMPONENTS = {
    "f": ("fi", "fp", "fo", "si"),
    "w": ("wi", "wp", "wo", "swi"),
    "m": ("mi", "mp", "mo"),
    "T": ("dT",),
}
_RANGES = {"f": "force", "w": "rate", "m": "field", "T": "temperature"}  # fields of the validity


class Excess(NamedTuple):
    """One quantity in which an operating point is outside the validity, with a sentence about it.

    Parameters
    ----------
    part : "f", "w", "m" or "T"
    amount : float
        How far it is outside the range, SI.
    text : str
    """

    part: str
    amount: float
    text: str


@dataclass(frozen=True, eq=False)
class Prediction:
    """What a calibration predicts for n operating points and q corrected quantities.

    Parameters
    ----------
    names : tuple of q str
        "fx", "fy", "fz", "wx", "wy", "wz" and "mx", "my", "mz", or fewer components
        (`Sensor.sensed`).
    measures : tuple of q "f", "w" or "m"
    f, w : (n, 3) arrays
        Specific force in m/s² and angular rate in rad/s of each point.
    temperature : (n,) array
        Temperature of each point, K; NaN if neither the point nor the calibration states it.
    value : (n, q) array
        Values after the correction, SI. Without noise they are those of the point.
    raw_error : (n, q) array
        Nominal readings minus true values, SI.
    std : (n, q) array
        Standard uncertainty of the corrected values, SI. It does not include the noise of a
        reading.
    groups, bench, effects : mapping of str to (n, q) array
        Shares of the variance. Those of `groups` (of coefficients) and `effects` add up to 1, and
        so do those of `bench` and `effects`. `bench` is empty if the calibration does not state
        shared errors; `effects` contains the effects that were added outside the validity.
    outside : tuple of n tuples of Excess
        The parts of each point that are outside the validity.
    remarks : tuple of str
        Sentences on what could not be checked or is not included in U.
    m : (n, 3) array or None
        Magnetic flux density of each point, T; None if there are no magnetometers.
    heading_std : (n,) array or None
        Standard uncertainty of the magnetic heading at rest, from the corrected f and m, rad; NaN
        if the point states no f or no horizontal m, and None if the sensor does not measure both.
    """

    names: tuple[str, ...]
    measures: tuple[Measures, ...]
    f: Array
    w: Array
    temperature: Array
    value: Array
    raw_error: Array
    std: Array
    groups: Mapping[str, Array]
    bench: Mapping[str, Array]
    effects: Mapping[str, Array]
    outside: tuple[tuple[Excess, ...], ...]
    remarks: tuple[str, ...]
    m: Array | None = None
    heading_std: Array | None = None

    @property
    def expanded(self) -> Array:
        """Expanded uncertainty U = 2 u of the corrected values, (n, q), SI."""
        return COVERAGE * self.std


def predict(
    calibration: Calibration,
    f: ArrayLike | None = None,
    w: ArrayLike | None = None,
    temperature: ArrayLike | None = None,
    m: ArrayLike | None = None,
    *,
    extrapolate: bool = False,
) -> Prediction:
    """Return the prediction for some points; see `Calibration.predict`."""
    sensor, c, covariance = calibration.sensor, calibration.values, calibration.covariance
    if not calibration.states_uncertainty:
        raise InputError(
            f"calibration of {sensor.name}: it states no uncertainties, so none can be predicted; "
            "use a calibration that inercal made"
        )
    force, rate, field, kelvin = _points(calibration, f, w, m, temperature)
    motion = Motion(force, rate, dT=kelvin - sensor.reference_temperature, m=field)
    line = sensor.linearise(motion, c)
    outside = _excesses(calibration, line.reading, kelvin)
    beyond = next((j for j, one in enumerate(outside) if one), None)
    if beyond is not None and not extrapolate:
        raise InputError(
            f"point {beyond + 1} is outside the validity of the calibration: "
            f"{'; '.join(one.text for one in outside[beyond])}; give points inside, or allow it "
            "with --extrapolate (extrapolate=True)",
            key=outside[beyond][0].part,
        )
    # The result is the point itself, but beyond a fold of the model the correction is refused.
    inverse(sensor, line.reading, c, f=force, w=rate, m=field, dT=motion.dT)
    names, measures, rows, basis = sensor.sensed
    kinds = KINDS[: sensor.width // 3]
    true, back = np.concatenate([force, rate, field][: len(kinds)], axis=-1), rows @ basis
    nominal = np.array([np.kron([a.measures == kind for kind in kinds], a.i) for a in sensor.axes])
    raw = (line.reading - true @ nominal.T) @ (back @ np.linalg.pinv(nominal @ basis)).T
    gain = back @ np.linalg.pinv(line.slope @ basis)
    by = -gain @ line.design
    variance = np.einsum("...i,ij,...j->...", by, covariance, by)
    effects, remarks = _effect_variances(calibration, motion, gain, outside)
    total = variance + sum(effects.values(), np.zeros_like(variance))
    weight = 1 / np.where(total > 0, total, np.inf)
    stated = {
        "force": bool(force.any()),
        "rate": bool(rate.any()),
        "field": bool(field.any()),
        "temperature": temperature is not None or sensor.uses("dT"),
    }
    is_known = calibration.validity is not None and calibration.validity.temperature is not None
    return Prediction(
        names,
        measures,
        force,
        rate,
        kelvin if stated["temperature"] or is_known else np.full_like(kelvin, np.nan),
        true @ rows.T,
        raw,
        np.sqrt(total),
        {name: part * weight for name, part in _group_variances(calibration, by)},
        {name: part * weight for name, part in _bench_variances(calibration, by, variance)},
        {name: part * weight for name, part in effects.items()},
        outside,
        (*_unchecked(calibration, stated), *remarks),
        field if "m" in kinds else None,
        _heading_std(calibration, force, field, by),
    )


def _heading_std(calibration: Calibration, f: Array, m: Array, by: Array) -> Array | None:
    """Return u of the heading, (n,), from the derivatives of the corrected values, (n, q, p)."""
    sensor = calibration.sensor
    if sensor.rank("f") < len("xyz") or sensor.rank("m") < len("xyz"):
        return None
    own = [k for k, kind in enumerate(sensor.sensed.measures) if kind in ("f", "m")]
    g = np.einsum("nq,nqp->np", heading_gradient(f, m), by[:, own])
    variance = np.einsum("ni,ij,nj->n", g, calibration.covariance, g)
    return np.sqrt(np.maximum(variance, 0.0))  # rounding may make it negative


def calibration_temperature(calibration: Calibration) -> float:
    """Return the temperature of a point that states none, K.

    It is the reference temperature of a model with temperature terms if the data cover it, and
    otherwise the middle of the temperatures of the data.
    """
    reference = calibration.sensor.reference_temperature
    known = None if calibration.validity is None else calibration.validity.temperature
    used = calibration.sensor.uses("dT")
    if known is None or (used and known[0] <= reference <= known[1]):
        return reference
    return (known[0] + known[1]) / 2


def _points(
    calibration: Calibration,
    f: ArrayLike | None,
    w: ArrayLike | None,
    m: ArrayLike | None,
    temperature: ArrayLike | None,
) -> tuple[Array, Array, Array, Array]:
    """Return force, rate and field, (n, 3), and temperatures, (n,), of all points."""
    sensor = calibration.sensor
    default = calibration_temperature(calibration) if temperature is None else temperature
    given = zip(KINDS, (f, w, m), strict=True)
    vectors: dict[str, Array] = {
        part: np.atleast_2d(np.asarray(np.zeros(3) if one is None else one, float))
        for part, one in given
    }
    vectors["T"] = np.atleast_1d(np.asarray(default, float))
    count = max(map(len, vectors.values()))
    for part, one in vectors.items():
        fits = one.shape[1:] == (3,) * (part != "T") and len(one) in (1, count)
        if not (fits and np.isfinite(one).all() and (part != "T" or one.min() > 0)):
            what = "temperatures above −273.15 °C" if part == "T" else "finite values (n, 3)"
            raise InputError(f"{part} needs {what}", key=part)
        unmeasured = part != "T" and all(axis.measures != part for axis in sensor.axes)
        if unmeasured and one.any() and not sensor.uses(*_COMPONENTS[part]):
            raise InputError(
                f"{part}: sensor {sensor.name} has no {QUANTITIES[part].sensors}, and none of its "
                f"coefficients depends on the {QUANTITIES[part].name}; leave out {part}",
                key=part,
            )
    force, rate, field, kelvin = (
        np.broadcast_to(one, (count, *one.shape[1:])) for one in vectors.values()
    )
    return force, rate, field, kelvin


def _excesses(
    calibration: Calibration, reading: Array, kelvin: Array
) -> tuple[tuple[Excess, ...], ...]:
    """Return the parts of each point that are outside the validity."""
    ranges = {} if calibration.validity is None else calibration.validity.ranges
    axes, found = calibration.sensor.axes, [list[Excess]() for _ in kelvin]
    for part, field in _RANGES.items():
        at = [k for k, axis in enumerate(axes) if axis.measures == part]
        values = kelvin[:, None] if part == "T" else reading[:, at]
        if field not in ranges or not values.shape[1]:
            continue
        low, high = limits = ranges[field]
        margin = TEMPERATURE_MARGIN if part == "T" else READING_MARGIN * (high - low)
        away = distance_outside(limits, values, margin)
        unit, si = SHOWN.get(part, ("K", 1.0))
        for j in np.flatnonzero(away.any(axis=1)).tolist():
            k = int(np.argmax(away[j]))
            what = "T is" if part == "T" else f"{axes[at[k]].name} would read"
            zero, word = (ZERO_CELSIUS, "°C") if part == "T" else (0.0, unit)
            here, *ends = (f"{(x - zero) / si:.4g}" for x in (values[j, k], low, high))
            text = (
                f"{what} {here} {word}, {away[j, k] / si:.4g} {unit} outside the range of the "
                f"data ({' to '.join(ends)} {word})"
            )
            found[j].append(Excess(part, float(away[j, k]), text.replace("-", "−")))
    return tuple(map(tuple, found))


def _unchecked(calibration: Calibration, stated: Mapping[str, bool]) -> Iterator[str]:
    """Yield a sentence for each part of the points that is stated and cannot be checked."""
    ranges = {} if calibration.validity is None else calibration.validity.ranges
    words = {"force": "specific forces", "rate": "rates", "temperature": "temperatures"}
    words["field"] = "magnetic fields"
    for field, used in stated.items():
        if used and field not in ranges:
            yield f"The calibration does not state the {words[field]} of its data."


def _group_variances(calibration: Calibration, by: Array) -> Iterator[tuple[str, Array]]:
    """Yield the contribution of each group of coefficients to the variance, (n, q)."""
    groups: dict[str, list[int]] = {}
    for k, name in enumerate(calibration.sensor.coefficients):
        group = calibration.sensor.coefficient(name).group.partition("_")[0]
        groups.setdefault(GROUP_WORDS.get(group, group), []).append(k)
    for group, at in groups.items():
        yield group, np.einsum("...i,ij,...j->...", by[..., at], calibration.covariance[at], by)


def _bench_variances(
    calibration: Calibration, by: Array, rest: Array
) -> Iterator[tuple[str, Array]]:
    """Yield the contribution of each shared error of the bench to the variance, then the rest."""
    for one in calibration.shared or ():
        part = (by @ (one.covariance / one.std)) ** 2
        rest = rest - part
        yield f"bench: {one.name}", part
    if calibration.shared is not None:
        yield OWN_ERRORS, rest


def _effect_variances(
    calibration: Calibration, motion: Motion, gain: Array, outside: tuple[tuple[Excess, ...], ...]
) -> tuple[dict[str, Array], list[str]]:
    """Return the variances of undetectable effects at points outside, (n, q), and remarks."""
    sensor, verdict = calibration.sensor, calibration.verdict
    causes = None if verdict is None else verdict.undetectable
    parts, remarks = {one.part for each in outside for one in each}, list[str]()
    if parts and causes is None:
        remarks.append(
            "U does not grow outside the validity, because the file does not list "
            "undetectable effects."
        )
    if "T" in parts and not sensor.uses("dT"):
        remarks.append("U does not include effects of temperature, because the model has none.")
    found: dict[str, Array] = {}
    for cause in causes or ():
        if CoefficientName(cause.component).axis not in sensor.channels:
            continue  # a drift, or a change within a section
        basis = coefficient_definition(sensor, cause.component).basis
        acting = {part for part in parts if basis.uses(*_COMPONENTS[part])}
        words = coefficient_words(sensor, cause.name, (cause.component,))
        if acting and not np.isfinite(cause.size):
            remarks.append(f"U does not include the {words}, whose size is not known.")
        elif acting:
            sized = _with_effect(sensor, cause)
            design = sized.linearise(motion, np.zeros(len(sized.coefficients))).design
            here = np.array([any(one.part in acting for one in each) for each in outside])
            squares = np.sum((cause.size * design) ** 2, axis=-1) / 3
            found[words] = (gain**2 @ squares[..., None])[..., 0] * here[:, None]
    if parts and not (found or remarks):
        remarks.append(
            "U does not grow outside the validity, because no undetectable effect acts there."
        )
    return found, remarks


def _with_effect(sensor: Sensor, cause: UndetectableCause) -> Sensor:
    """Return the sensor with only an effect; its size is known for one axis and used for all.

    If a group names the effect, it is used for all terms of this group that have the same unit.
    """
    axis, term = CoefficientName(cause.component).parts
    named, group = CoefficientName(cause.name).parts
    own = coefficient_definition(sensor, cause.component)
    kind = sensor.measures[axis]
    names = (
        f"{one.name}.{line.name}"
        for one in sensor.axes
        for line in TABLES[kind]
        if one.measures == kind
        and named in ("", one.name)
        and (line.name == term or (line.group == group and line.unit == own.unit))
    )
    kept = tuple(name for name in names if name not in sensor.coefficients)
    return replace(sensor, coefficients=kept)


__all__ = ["OWN_ERRORS", "SHOWN", "Excess", "Prediction", "calibration_temperature", "predict"]

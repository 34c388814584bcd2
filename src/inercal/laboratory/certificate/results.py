"""Round the results of a certificate, and state whether they conform to the limits.

The expanded uncertainty is U = k u, with a coverage probability of 95.45 %. For a normal
distribution, this is k = 2. If the effective degrees of freedom ν are few, k = t(ν) (JCGM 100:2008,
G.4). U must not be below the capability of the laboratory (ILAC-P14:09/2020). If it is, the
covariance is scaled to V′ = D V D with D = max(1, U_CMC/U), which preserves all correlations.

U has two significant digits, and the value is rounded to the same digit. PDF and DCC both use these
decimal numbers, so they agree. In SI, the rounded numbers are multiplied by the size of the unit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from math import inf
from typing import Literal

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, error_location
from inercal.basics.keys import CoefficientName
from inercal.basics.units import format_value_and_uncertainty, parse_quantity
from inercal.calibration import Calibration
from inercal.calibration.specification import Conformity, LimitResult
from inercal.estimation.uncertainty.conformity import (
    RESULTS,
    conformance_probability,
    expanded_uncertainty,
    joint_conformance_probability,
    judge,
)
from inercal.physics.sensors import SI_UNITS, Sensor, imu
from inercal.physics.sensors.coefficient_selection import select_coefficients
from inercal.physics.sensors.coefficient_tables import Basis

Status = Literal["", "beforeAdjustment", "afterAdjustment"]
_COMPONENTS = {
    **{f"{letter}{axis}": f"{symbol}_{axis.upper()}"
       for letter, symbol in (("f", "f"), ("w", "ω"), ("a", "α"), ("m", "m")) for axis in "ipo"},
    "si": "sgn(f_I)",
    "swi": "sgn(ω_I)",
    "dT": "ΔT",
    "dTdt": "dT/dt",
}  # fmt: skip
_SUPERSCRIPTS = str.maketrans("23456789", "²³⁴⁵⁶⁷⁸⁹", "1")


@dataclass(frozen=True)
class ResultRow:
    """A coefficient with its expanded uncertainty, both rounded.

    Parameters
    ----------
    name, meaning, unit, si_unit : str
    term : str
        Printed form of the coefficient's basis function.
    value, expanded : str
        Value and U as decimal numbers, in `unit`.
    si : float
        Size of the unit in SI units.
    raised : bool
        Whether U was increased to the capability of the laboratory.
    outside : bool
        Whether the laboratory states no capability for the coefficient.
    """

    name: str
    meaning: str
    unit: str
    si_unit: str
    term: str
    value: str
    expanded: str
    si: float
    raised: bool
    outside: bool

    @property
    def value_si(self) -> float:
        """The rounded value in SI units."""
        return float(Decimal(self.value) * Decimal(repr(self.si)))

    @property
    def expanded_si(self) -> float:
        """The rounded expanded uncertainty in SI units."""
        return float(Decimal(self.expanded) * Decimal(repr(self.si)))


@dataclass(frozen=True, eq=False)
class ResultSet:
    """The coefficients of one calibration, as a certificate states them.

    Parameters
    ----------
    status : "", "beforeAdjustment" or "afterAdjustment"
    calibration : Calibration
    covariance : (p, p) array
        Covariance in SI units, increased to the capability of the laboratory.
    dof : float
        Effective degrees of freedom; infinite if none are stated.
    k : float
        Coverage factor.
    rows : tuple of ResultRow
    """

    status: Status
    calibration: Calibration
    covariance: Array
    dof: float
    k: float
    rows: tuple[ResultRow, ...]


def make_results(
    calibration: Calibration,
    capability: Mapping[str, float] | None,
    dof: float,
    status: Status = "",
) -> ResultSet:
    """Return the results of a calibration for a certificate.

    Parameters
    ----------
    calibration : Calibration
    capability : mapping of str to float, or None
        Smallest U in SI by full name of the coefficient; None if the laboratory states no
        capability.
    dof : float
    status : str
    """
    k = float(expanded_uncertainty(np.ones(()), dof))
    smallest = capability or {}
    names = calibration.sensor.coefficients
    wanted = np.array([smallest.get(name, 0.0) for name in names])
    u = calibration.std
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(k * u < wanted, wanted / (k * u), 1.0)
    exact = (u == 0) & (wanted > 0)
    scale[exact] = 1.0
    covariance = calibration.covariance * np.outer(scale, scale)
    covariance[np.diag_indices_from(covariance)] += np.where(exact, (wanted / k) ** 2, 0.0)
    std = np.sqrt(np.diag(covariance))
    rows: list[ResultRow] = []
    for name, value, each, was in zip(names, calibration.values, std, u, strict=True):
        term = calibration.sensor.coefficient(name)
        shown = format_value_and_uncertainty(float(value) / term.si, k * float(each) / term.si)
        rows.append(
            ResultRow(
                name, term.meaning, term.unit, SI_UNITS[term.unit], _term_text(term.basis),
                *shown, term.si, each > was, capability is not None and name not in capability,
            )
        )  # fmt: skip
    return ResultSet(status, calibration, covariance, dof, k, tuple(rows))


def stated_capability(uncertainty: Mapping[str, str], sensor: Sensor) -> dict[str, float]:
    """Return the smallest U that a laboratory states for each coefficient, SI.

    Raises
    ------
    InputError
        If a quantity is invalid or not positive, or a word does not name a coefficient of any
        sensor. Coefficients that this sensor does not have are ignored, because the laboratory uses
        the file for all sensors.
    """
    found: dict[str, float] = {}
    for word, text in sorted(uncertainty.items(), key=lambda one: "." in one[0]):
        key = f"[capability.uncertainty] {word}"
        with error_location(key, key=key):
            select_coefficients(imu().axes, [CoefficientName(word).term])
        try:
            named = select_coefficients(sensor.axes, [word])
        except InputError:
            continue
        values: dict[str, float] = {}
        errors: list[InputError] = []
        for name in named:
            if name in sensor.coefficients:
                try:
                    values[name] = parse_quantity(text, sensor.coefficient(name).unit).value
                except InputError as error:  # such as "bias" in a unit of the other kind of sensor
                    errors.append(error)
        if errors and not values:
            raise errors[0].located(key, key=key)
        if any(value <= 0 for value in values.values()):
            raise InputError(f"{key}: {text!r} must be positive", key=key)
        found |= values
    return found


def judge_results(results: ResultSet) -> Conformity | None:
    """Judge conformity with the limits of the calibration, using the U of the certificate.

    If limits were judged by the U of the next use, they are judged in this way again, with k = 2.
    If the laboratory's capability increases the U of the session, the same variance is added to the
    U of the next use. The calibration file states the scatter between uses without correlations, so
    the joint probability treats this scatter as uncorrelated.
    """
    stated = results.calibration.conformity
    if stated is None:
        return None
    names = list(results.calibration.sensor.coefficients)
    chosen = [names.index(one.name) for one in stated.limits]
    value = results.calibration.values[chosen]
    covariance = results.covariance[np.ix_(chosen, chosen)]
    dof = _conformity_dof(stated, results.dof)
    if stated.uncertainty == "next_use":
        session = results.calibration.covariance[np.ix_(chosen, chosen)]
        if np.array_equal(covariance, session):
            return stated
        next_use = np.array([one.std**2 for one in stated.limits])
        covariance = covariance + np.diag(next_use - np.diag(session))
    std = np.sqrt(np.diag(covariance))
    lower = np.array([one.lower for one in stated.limits])
    upper = np.array([one.upper for one in stated.limits])
    guard = stated.rule.guard(std, dof)
    found = judge(value, lower, upper, guard)
    chance = conformance_probability(value, std, lower, upper, dof)
    limits = tuple(
        LimitResult(
            one.name, one.lower, one.upper, float(value[k]), float(std[k]), float(guard[k]),
            RESULTS[int(found[k])], float(chance[k]),
        )
        for k, one in enumerate(stated.limits)
    )  # fmt: skip
    joint = joint_conformance_probability(value, covariance, lower, upper)
    return Conformity(stated.rule, limits, joint, stated.uncertainty)


def _conformity_dof(conformity: Conformity, dof: float) -> float:
    """Return ν for the U used to judge limits; the U of the next use already includes t(ν)."""
    return inf if conformity.uncertainty == "next_use" else dof


def acceptance_risk(conformity: Conformity, dof: float = inf) -> float:
    """Return the largest risk that a true value exceeds a limit if the result is accepted.

    The guard band is w = factor · U. If a value has only one limit, the risk is the tail of the
    distribution beyond w: 2.28 % for w = 2u, and 4.9 % for w = 0.83 U (JCGM 106:2012, 8.3.2;
    ILAC-G8:09/2019).
    """
    dof = _conformity_dof(conformity, dof)
    guard = float(conformity.rule.guard(np.ones(()), dof))
    beyond = conformance_probability(np.zeros(()), np.ones(()), np.array(guard), np.array(inf), dof)
    return float(beyond)


def names_of(rows: Sequence[ResultRow], *, raised: bool = False) -> tuple[str, ...]:
    """Return the names of coefficients outside the capability or, if `raised`, with a larger U."""
    return tuple(row.name for row in rows if (row.raised if raised else row.outside))


def _term_text(basis: Basis) -> str:
    parts: list[str] = []
    for product in basis.products:
        words: list[str] = []
        for name in dict.fromkeys(product.components):
            words.append(
                _COMPONENTS[name] + str(product.components.count(name)).translate(_SUPERSCRIPTS)
            )
        size = abs(product.factor)
        factor = [] if size == 1 and words else [f"{size:g}"]
        text = " · ".join(factor + words)
        sign = "−" if product.factor < 0 else "+" if parts else ""
        parts.append(f"{sign} {text}" if parts else f"{sign}{text}")
    return " ".join(parts)

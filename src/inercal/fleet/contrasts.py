"""Find trends and differences in a fleet: contrasts aᵀy, whose variance allows for lots.

Sensors from one production lot are similar, so they provide less information than independent
sensors. The variance of a contrast is therefore::

    var aᵀy = Σ a_i² (u_i² + σ²) + σ_L² Σ_lots (Σ_i∈lot a_i)²

Contrasts are tested with Student's distribution. Its degrees of freedom combine those of both
scatters (Welch and Satterthwaite). The expected share of false positives among the significant
contrasts of a fleet is limited (`false_discovery_selection`).
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from inercal.basics.arrays import Array
from inercal.estimation.uncertainty.components import Components
from inercal.estimation.uncertainty.robust import FALSE_DISCOVERIES, false_discovery_selection
from inercal.fleet.population import Grouping

_LEAST_SENSORS = 3  # sensors needed at a station for a difference


@dataclass(frozen=True)
class Contrast:
    """A trend or a station difference in one coefficient, in SI units.

    Parameters
    ----------
    coefficient, of : str
        `of` is "serial order", "time" or a station.
    value, std : float
        Change over the whole range of serial order or time, or difference from all other stations,
        and its standard uncertainty.
    p_value : float
    significant : bool
        Whether the contrast is significant, at the chosen false discovery rate.
    """

    coefficient: str
    of: str
    value: float
    std: float
    p_value: float
    significant: bool = False


def trend(
    name: str, at: Array, names: Sequence[str], value: Array, std: Array, lots: Grouping,
    components: Sequence[Components],
) -> list[Contrast]:  # fmt: skip
    """Return the change of each coefficient along a straight line over the range of `at`.

    Parameters
    ----------
    name : str
        What `at` contains, "serial order" or "time".
    at : (n,) array
        Serial order or time; rows with NaN are ignored.
    names : sequence of str
        Names of the p coefficients.
    value, std : (n, p) arrays
    lots : Grouping
    components : sequence of Components
        Variance components for each coefficient.
    """
    known = np.isfinite(at)
    off = np.where(known, at - np.mean(at[known]), 0.0) if known.any() else np.zeros(at.shape)
    total = float(off @ off)
    if total == 0 or known.sum() < _LEAST_SENSORS:
        return []
    weights = off * (np.ptp(at[known]) / total)
    return _contrasts(name, weights, names, value, std, lots, components)


def station_differences(
    stations: Grouping, names: Sequence[str], value: Array, std: Array, lots: Grouping,
    components: Sequence[Components],
) -> list[Contrast]:  # fmt: skip
    """Return the mean of each station minus the mean over the sensors of all other stations."""
    found: list[Contrast] = []
    for k, station in enumerate(stations.names):
        own = stations.places == k
        count, others = int(own.sum()), int((~own).sum())
        if min(count, others) >= _LEAST_SENSORS:
            weights = np.where(own, 1 / count, -1 / others)
            found += _contrasts(station, weights, names, value, std, lots, components)
    return found


def marked(contrasts: Sequence[Contrast], rate: float = FALSE_DISCOVERIES) -> list[Contrast]:
    """Return the contrasts; mark significant contrasts, at a false discovery rate."""
    tails = np.array([one.p_value for one in contrasts])
    chosen = set(false_discovery_selection(tails, rate).tolist()) if contrasts else set[int]()
    return [replace(one, significant=k in chosen) for k, one in enumerate(contrasts)]


def _contrasts(
    of: str, weights: Array, names: Sequence[str], value: Array, std: Array, lots: Grouping,
    components: Sequence[Components],
) -> list[Contrast]:  # fmt: skip
    centre = np.median(value, axis=0)
    found = weights @ (value - centre)
    own = weights**2 @ std**2
    squares = float(weights @ weights)
    by_lot = np.bincount(lots.places, weights, len(lots.names))
    lot_squares = float(by_lot @ by_lot)
    contrasts: list[Contrast] = []
    for k, name in enumerate(names):
        one = components[k]
        variance = float(own[k]) + squares * one.within.sd**2
        spent = variance**2 / one.within.dof
        if one.lots is not None:
            part = lot_squares * one.lots.sd**2
            variance, spent = variance + part, spent + part**2 / one.lots.dof
        dof = variance**2 / spent if spent > 0 else 1.0
        u = variance**0.5
        ratio = abs(float(found[k])) / u if u > 0 else 0.0
        tail = 2 * float(scipy.special.stdtr(dof, -ratio))
        contrasts.append(Contrast(name, of, float(found[k]), u, tail))
    return contrasts

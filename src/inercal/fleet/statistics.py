"""Compute statistics over the sensors of a line: their true scatter, capability and yield.

The scatter of the values includes their uncertainties, so the standard deviation of the true values
is √(sd² − mean u²). `inercal.estimation.uncertainty.components` computes the components between and
within lots. The capability of a process with the limits T_L and T_U, and its 95 % interval, are

    C_pk = min(T_U − μ, μ − T_L) / 3σ,   its interval C_pk ± 1.96 √(1/9n + C_pk²/(2n − 2))

(Bissell 1990, Applied Statistics 39, 331–340): the observed capability uses the sd of the values,
and the true capability uses the sd of the true values. Outliers are excluded from means, scatter,
capability, trends and differences, but not from medians, quantiles and the yield.

u includes errors of the bench that are common to all sensors. These errors do not make the values
scatter. If they dominate, the true scatter is larger than stated, and u of a mean is never below
the u of these errors.
"""

from dataclasses import dataclass
from math import nan
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.estimation.uncertainty.components import Components, variance_components
from inercal.estimation.uncertainty.conformity import RESULTS, DecisionRule, judge
from inercal.estimation.uncertainty.robust import (
    LEAST_ROWS,
    NAMED_BY_CHANCE,
    find_outliers,
    robust_scale,
    squared_distances,
)
from inercal.fleet.contrasts import Contrast, marked, station_differences, trend
from inercal.fleet.control_chart import ControlChart, control_charts
from inercal.fleet.population import Grouping, Indices, Mask, Population

QUANTILES = (0.01, 0.05, 0.25, 0.75, 0.95, 0.99)
TRENDS = ("serial order", "time")


class Capability(NamedTuple):
    """C_pk and the limits of its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Summary:
    """Summary of one coefficient over several sensors, in SI units.

    Parameters
    ----------
    n : int
        Number of sensors.
    median, robust_sd : float
        Median and robust standard deviation over all sensors.
    mean, sd : float
        Mean and standard deviation without outliers.
    mean_u : float
        Root mean square of the standard uncertainties.
    truth_sd : float
        √(sd² − mean u²); NaN if the values scatter less than their uncertainties.
    """

    n: int
    median: float
    robust_sd: float
    mean: float
    sd: float
    mean_u: float
    truth_sd: float


@dataclass(frozen=True)
class CoefficientStatistics:
    """Statistics of one coefficient over the fleet, in SI units.

    Parameters
    ----------
    name : str
    summary : Summary
    quantiles : tuple of float
        Values at the probabilities in `QUANTILES`.
    components : Components
    limits : (float, float) or None
        Limits in [specification].
    observed, truth : Capability or None
        Observed and true capability; None if there are no limits or no scatter.
    """

    name: str
    summary: Summary
    quantiles: tuple[float, ...]
    components: Components
    limits: tuple[float, float] | None
    observed: Capability | None
    truth: Capability | None


@dataclass(frozen=True)
class GroupStatistics:
    """A lot or a station, with the number of its sensors and a summary of each coefficient."""

    name: str
    summaries: tuple[Summary, ...]


@dataclass(frozen=True)
class Outlier:
    """A sensor that differs from the others, and the coefficient that contributes most."""

    id: str
    distance: float
    coefficient: str
    value: float


@dataclass(frozen=True)
class RuleYield:
    """Number of sensors with each result under a decision rule.

    Parameters
    ----------
    rule : DecisionRule
    counts : mapping of str to int
    unjudged : int
        Number of sensors that have no usable result, although they were calibrated or failed.
    """

    rule: DecisionRule
    counts: dict[str, int]
    unjudged: int = 0

    @property
    def sensors(self) -> int:
        """Return the number of sensors that the yield includes."""
        return sum(self.counts.values()) + self.unjudged

    @property
    def share(self) -> float:
        """Return the share of the sensors that pass; a sensor without a result does not pass."""
        return self.counts["pass"] / max(self.sensors, 1)


@dataclass(frozen=True)
class FleetStatistics:
    """All statistics of a line.

    Parameters
    ----------
    population : Population
    coefficients : tuple of CoefficientStatistics
    lots, stations : tuple of GroupStatistics
        Statistics of each lot and of each station; empty if there is only one.
    outliers : tuple of Outlier
        Outliers; the sensor farthest from the others comes first.
    outliers_searched : bool
        Whether there were enough sensors for the search.
    outliers_by_chance : float
        Mean number of outliers that would be listed if no sensor really differed from the others.
    contrasts : tuple of Contrast
        Trends over serial order and time, and differences between stations.
    yields : tuple of RuleYield
        Yield under each decision rule; empty if there are no limits.
    centre : float
        Centre of the control charts.
    charts : tuple of ControlChart
    """

    population: Population
    coefficients: tuple[CoefficientStatistics, ...]
    lots: tuple[GroupStatistics, ...]
    stations: tuple[GroupStatistics, ...]
    outliers: tuple[Outlier, ...]
    outliers_searched: bool
    outliers_by_chance: float
    contrasts: tuple[Contrast, ...]
    yields: tuple[RuleYield, ...]
    centre: float
    charts: tuple[ControlChart, ...]


def fleet_statistics(population: Population) -> FleetStatistics:
    """Return the statistics of the calibrated sensors of a line.

    Raises
    ------
    InputError
        No lot has two or more sensors.
    """
    n = len(population.ids)
    searched = n >= LEAST_ROWS
    far, named = _outliers(population) if searched else (np.zeros(0, dtype=np.intp), ())
    good = np.ones(n, dtype=bool)
    good[far] = False
    value, std = population.value[good], population.std[good]
    lots = _rows_of(population.lots, good)
    if n < 2:
        raise InputError("the scatter cannot be estimated from one sensor; calibrate more sensors")
    components = _components(value, std, lots)
    stated = population.specification
    limits = {} if stated is None else dict(stated.limits)
    contrasts = [
        *trend(TRENDS[0], np.flatnonzero(good).astype(float), population.names, value, std, lots,
               components),
        *trend(TRENDS[1], population.days[good], population.names, value, std, lots, components),
        *station_differences(_rows_of(population.stations, good), population.names, value, std,
                             lots, components),
    ]  # fmt: skip
    summaries = _summaries(population.value, population.std, good)
    known = [limits.get(name) for name in population.names]
    quantiles = np.quantile(population.value, QUANTILES, axis=0).T
    centre, charts = control_charts(population)
    return FleetStatistics(
        population,
        tuple(
            CoefficientStatistics(
                name,
                one,
                tuple(quantiles[k].tolist()),
                components[k],
                known[k],
                *(capability(one.mean, sd, one.n, known[k]) for sd in (one.sd, one.truth_sd)),
            )
            for k, (name, one) in enumerate(zip(population.names, summaries, strict=True))
        ),
        _groups(population, population.lots, good),
        _groups(population, population.stations, good),
        named,
        searched,
        NAMED_BY_CHANCE,
        tuple(marked(contrasts)),
        tuple(_yields(population)),
        centre,
        tuple(charts),
    )


def capability(
    mean: float, sd: float, n: int, limits: tuple[float, float] | None
) -> Capability | None:
    """Return C_pk with its interval, or None if there are no limits or no scatter."""
    if limits is None or not sd > 0 or n < 2:
        return None
    value = min(limits[1] - mean, mean - limits[0]) / (3 * sd)
    half = 1.96 * (1 / (9 * n) + value**2 / (2 * n - 2)) ** 0.5
    return Capability(value, value - half, value + half)


def _summaries(value: Array, std: Array, good: Mask) -> list[Summary]:
    """Return a summary of each column; means and scatter use only the rows in `good`."""
    kept, u = value[good], std[good]
    if len(kept) < 2:
        kept, u = value, std
    median, robust = np.median(value, axis=0), robust_scale(value)
    mean = kept.mean(axis=0)
    sd = kept.std(axis=0, ddof=1) if len(kept) > 1 else np.full(value.shape[1], nan)
    mean_u = np.sqrt((u**2).mean(axis=0))
    excess = sd**2 - mean_u**2
    truth = np.where(excess >= 0, np.sqrt(np.maximum(excess, 0.0)), nan)
    table = np.stack([median, robust, mean, sd, mean_u, truth], axis=1)
    return [Summary(len(value), *map(float, row)) for row in table]


def _groups(population: Population, grouping: Grouping, good: Mask) -> tuple[GroupStatistics, ...]:
    if not grouping.several:
        return ()
    order = np.argsort(grouping.places, kind="stable")
    ends = np.searchsorted(grouping.places[order], np.arange(len(grouping.names) + 1))
    return tuple(
        GroupStatistics(
            name, tuple(_summaries(population.value[rows], population.std[rows], good[rows]))
        )
        for name, rows in (
            (name, order[ends[k] : ends[k + 1]]) for k, name in enumerate(grouping.names)
        )
    )


def _rows_of(grouping: Grouping, good: Mask) -> Grouping:
    """Return the grouping of only some rows, without groups that become empty."""
    places = grouping.places[good]
    used = np.bincount(places, minlength=len(grouping.names)) > 0
    names = tuple(name for name, one in zip(grouping.names, used.tolist(), strict=True) if one)
    return Grouping(names, (np.cumsum(used) - 1)[places])


def _components(value: Array, std: Array, lots: Grouping) -> list[Components]:
    # If each lot has one sensor, there is no information on the scatter within a lot.
    places = lots.places if len(value) > len(lots.names) else None
    return [variance_components(value[:, k], std[:, k], places) for k in range(value.shape[1])]


def _outliers(population: Population) -> tuple[Indices, tuple[Outlier, ...]]:
    """Return the row indices of the outliers, and the outliers themselves."""
    spread = robust_scale(population.value) ** 2
    excess = np.maximum(spread - np.median(population.std, axis=0) ** 2, 0.0)
    scale = np.sqrt(population.std**2 + excess)
    scale = np.where(scale > 0, scale, 1.0)
    off = (population.value - np.median(population.value, axis=0)) / scale
    distances, shares = squared_distances(off)
    found = find_outliers(off, distances)
    rows: list[int] = found.tolist()
    worst: list[int] = np.argmax(shares[found], axis=1).tolist()
    return found, tuple(
        Outlier(
            population.ids[row], float(distances[row]), population.names[k],
            float(population.value[row, k]),
        )
        for row, k in zip(rows, worst, strict=True)
    )  # fmt: skip


def _yields(population: Population) -> list[RuleYield]:
    """Return the yields under the template's decision rule and under the other common rules."""
    if population.judged is not None:
        return [RuleYield(*population.judged, population.unjudged)]
    specification = population.specification
    if specification is None:
        return []
    rules = dict.fromkeys(
        (specification.rule, DecisionRule(), DecisionRule(factor=0.83), DecisionRule("simple"))
    )
    columns = [population.names.index(name) for name in specification.limits if name in
               population.names]  # fmt: skip
    if not columns:
        return []
    bounds = [specification.limits[population.names[k]] for k in columns]
    value, std = population.value[:, columns], population.std[:, columns]
    lower, upper = np.array(bounds).T
    found: list[RuleYield] = []
    for rule in rules:
        worst = judge(value, lower, upper, rule.guard(std)).max(axis=1)
        counts = np.bincount(worst, minlength=len(RESULTS)).tolist()
        judged: dict[str, int] = dict(zip(RESULTS, counts, strict=True))
        found.append(RuleYield(rule, judged, population.unjudged))
    return found

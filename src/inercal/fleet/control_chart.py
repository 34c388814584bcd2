"""Compute a control chart for each station: χ²/ν of the residuals over time.

The residuals do not depend on the sensors' coefficients, so their scatter shows errors of the table
or the fixture, and the noise. A point is the sum of χ² over consecutive runs, divided by the sum of
ν. The limits are around the median of all runs. The probability that any point is beyond them by
chance is 0.27 %. If the stated noise is too large for all sensors, the fleet is still in control,
but the centre is not 1.
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false

from dataclasses import dataclass

import numpy as np
import scipy

from inercal.basics.arrays import Array
from inercal.fleet.population import Indices, Population

LEVEL = 0.0027  # probability for all points together, as for ±3 σ
_POINTS = 100  # largest number of points for a station


@dataclass(frozen=True)
class ControlChart:
    """The control chart for one station.

    Parameters
    ----------
    station : str
    at : (m,) array
        Mean time of the runs in each point, days since 1970; if no time is stated, their mean
        serial number.
    ratio, low, high : (m,) arrays
        χ²/ν and its limits.
    runs : int
    """

    station: str
    at: Array
    ratio: Array
    low: Array
    high: Array
    runs: int

    @property
    def beyond(self) -> int:
        """Return the number of points beyond the limits."""
        return int(np.sum((self.ratio < self.low) | (self.ratio > self.high)))


def control_charts(population: Population) -> tuple[float, list[ControlChart]]:
    """Return the centre line, and a control chart for each station whose runs have χ²."""
    timed = bool(np.isfinite(population.days).all())
    at = population.days if timed else np.arange(len(population.ids), dtype=float)
    judged = np.isfinite(population.chi2) & (population.dof > 0)
    if not judged.any():
        return 1.0, []
    # The median of χ² is ν (1 − 2/9ν)³ (Wilson and Hilferty).
    dof = population.dof[judged]
    centre = float(np.median(population.chi2[judged] / (dof * (1 - 2 / (9 * dof)) ** 3)))
    groups: list[tuple[str, list[Indices]]] = []
    for k, station in enumerate(population.stations.names):
        rows = np.flatnonzero(judged & (population.stations.places == k))
        rows = rows[np.argsort(at[rows], kind="stable")]
        if rows.size:
            groups.append((station, np.array_split(rows, min(_POINTS, rows.size))))
    level = LEVEL / sum(len(parts) for _, parts in groups)
    charts: list[ControlChart] = []
    for station, parts in groups:
        chi2, dof, when = (
            np.array([each[part].sum() for part in parts])
            for each in (population.chi2, population.dof, at)
        )
        low, high = (
            centre * scipy.special.chdtri(dof, tail) / dof for tail in (1 - level / 2, level / 2)
        )
        counts = np.array([part.size for part in parts])
        charts.append(
            ControlChart(station, when / counts, chi2 / dof, low, high, int(counts.sum()))
        )
    return centre, charts

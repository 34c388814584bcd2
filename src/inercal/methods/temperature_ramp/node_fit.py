"""Fit a ramp with a coarse thermometer, whose temperature curve is estimated as nuisances.

At given coefficients and lag the nodes have a least-squares solution. With this solution the
derivatives of all rows are triangularised, with the nodes first. The rows below those of the nodes
form a problem with only the coefficients and the lag, which has the same χ² and covariance as the
joint problem (variable projection: Golub and Pereyra 1973, SIAM J. Numer. Anal. 10, 413–432;
Kaufman 1975, BIT 15, 49–57).

Only the first few τ of a warm-up determine the lag, while R leaves its equilibrium. Later R is an
exponential, and b(R) fits as well as b(T). If χ² without a lag is hardly larger, the nodes have
followed the noise. In that case neither the lag nor its uncertainty is meaningful.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import NotObserved
from inercal.basics.keys import CoefficientName
from inercal.estimation import Estimate
from inercal.methods import Priors
from inercal.methods.order_effects import with_tests_of_priors
from inercal.methods.temperature_ramp.ramp_fit import LAG, RampModel, solve_ramp
from inercal.methods.temperature_ramp.thermometer_steps import is_one_exponential
from inercal.physics.sensors.coefficient_tables import BIAS_UNITS
from inercal.recordings.environment import Environment

_ROUNDS = 30  # largest number of iterations for the nodes at given coefficients
_SETTLED = 1e-7  # relative to a node's standard uncertainty
_STARTS = (5.0, 40.0)  # s, start values of the lag
_NO_LAG = 0.5  # s
LEAST_GAIN = 60.0  # decrease of χ² due to a lag; separates good and bad cases in simulations


def fit_along_nodes(model: RampModel, priors: Priors, environment: Environment) -> Estimate:
    """Return the estimate for a ramp with a coarse thermometer.

    If the data determine a lag, a stated lag with its uncertainty is a prior. Otherwise the lag is
    used as stated.

    Parameters
    ----------
    model : RampModel
        The model with the nodes of the thermometer's temperature curve.
    priors : sequence of Gaussian
        Priors on coefficients.
    environment : Environment

    Raises
    ------
    NotObserved
        The lag is neither stated nor determined by the data, or a coefficient of the temperature's
        rate should be estimated.
    """
    if model.sensor.uses("dTdt") and model.blocks.is_monotonic:
        raise _rate_not_observed(model)
    if LAG not in model.nuisances:
        return _fit(model, priors, environment, 0.0)
    unstated = replace(environment, lag=None)
    fits = [_fit(model, priors, unstated, start) for start in _STARTS]
    best = min(fits, key=lambda one: (not one.converged, float(one.chi2)))
    without = _fit(_with_lag(model, _NO_LAG), priors, unstated, 0.0)
    gain = float(without.chi2) - float(best.chi2)
    stated = environment.lag
    if gain >= LEAST_GAIN:
        lag = float(best.value[-1])
        return best if stated is None else _fit(model, priors, environment, lag)
    if stated is None:
        raise _lag_not_observed(model, best.value, gain)
    held = _fit(_with_lag(model, stated.value), priors, unstated, 0.0)
    other = _fit(_with_lag(model, stated.value + stated.sd), priors, unstated, 0.0)
    moved = np.append(other.value - held.value, stated.sd)
    covariance = np.outer(moved, moved)
    covariance[:-1, :-1] += held.covariance
    return replace(
        held, names=model.names, value=np.append(held.value, stated.value), covariance=covariance
    )


def _with_lag(model: RampModel, lag: float) -> RampModel:
    """Return the model with a known lag, s."""
    return model._replace(nuisances=tuple(n for n in model.nuisances if n != LAG), lag=lag)


def _fit(model: RampModel, priors: Priors, environment: Environment, lag: float) -> Estimate:
    rows = len(model.names) + 1
    linearise = NodeProblem(model).linearise
    estimate = solve_ramp(model, priors, environment, linearise, rows, lag)
    # The remaining rows represent all blocks: there are as many node values as node priors.
    dof = estimate.dof + model.blocks.time.size * len(model.sensor.axes) - rows
    return with_tests_of_priors(replace(estimate, dof=dof), model.sensor, priors)


def _lag_not_observed(model: RampModel, x: Array, gain: float) -> NotObserved:
    course = model.blocks.course
    assert course is not None
    crossings = course.nodes.crossings
    one_way = " while the temperature only rises or only falls" if model.blocks.is_monotonic else ""
    begun = ""
    if is_one_exponential(crossings):
        begun = (
            "the warm-up had already become a single exponential, so start recording before "
            "the temperature changes; "
        )
    k = model.steepest_axis(x)
    axis = model.sensor.axes[k]
    shift, unit = model.largest_shift(x, k), BIAS_UNITS[axis.measures][1]
    return NotObserved(
        "these data do not determine the lag of the thermometer. It reports steps of "
        f"{crossings.step:.3g} K{one_way}, and without lag χ² is larger by only "
        f"{max(gain, 0.0):.0f} (less than {LEAST_GAIN:g}). An unknown lag shifts b(T) by b′ Ṫ "
        f"τ, up to {shift:.2g} {unit} per second of lag on {axis.name}; {begun}go up and down "
        "in temperature, or state [environment] lag with its uncertainty",
        (LAG,),
        key="[environment] lag",
        names=(LAG,),
    )


def _rate_not_observed(model: RampModel) -> NotObserved:
    course = model.blocks.course
    assert course is not None
    names = tuple(
        n for n in model.sensor.coefficients if CoefficientName(n).parts[1].endswith("dTdt")
    )
    return NotObserved(
        f"these data do not determine {', '.join(names)}. The thermometer reports steps of "
        f"{course.nodes.crossings.step:.3g} K while the temperature only rises or only falls; go "
        "up and down, or leave these coefficients out",
        names,
        names=names,
    )


class _Rows(NamedTuple):
    """Whitened residuals, and their Jacobians for the parameters and for the nodes."""

    residual: Array
    jacobian: Array
    by_node: Array

    @property
    def cost(self) -> float:
        return float(self.residual @ self.residual)


class NodeProblem:
    """The whitened rows of a ramp with its nodes eliminated.

    Parameters
    ----------
    model : RampModel
        The model for a coarse thermometer.
    """

    def __init__(self, model: RampModel):
        course = model.blocks.course
        assert course is not None
        self._model, self._sd = model, course.nodes.sd
        self._shift = np.zeros(self._sd.size)
        # For white noise the whitening is diagonal, and the products below are most of the work.
        diagonals = [np.diag(one) for one in model.whitening]
        self._white = all(
            np.count_nonzero(one) == np.count_nonzero(diagonal)
            for one, diagonal in zip(model.whitening, diagonals, strict=True)
        )
        self._diagonals = diagonals

    def solved(self, x: Array) -> RampModel:
        """Return the model with the nodes that fit best for parameters x."""
        self.linearise(x)
        return self._model._replace(node_shift=self._shift)

    def rows(self, x: Array) -> tuple[Array, Array]:
        """Return all residuals, and their Jacobian for the parameters and then for the nodes."""
        rows = self._rows(x, self._shift)
        return rows.residual, np.concatenate([rows.jacobian, rows.by_node], axis=1)

    def linearise(self, x: Array) -> tuple[Array, Array]:
        """Return the p + 1 residuals that remain after the nodes are fitted, and their Jacobian."""
        rows = self._rows(x, self._shift)
        for _ in range(_ROUNDS):
            move = np.linalg.solve(rows.by_node.T @ rows.by_node, rows.by_node.T @ rows.residual)
            tried = self._rows(x, self._shift + move)
            while tried.cost > rows.cost and np.abs(move / self._sd).max() > _SETTLED:
                move = np.asarray(0.5 * move, dtype=np.float64)
                tried = self._rows(x, self._shift + move)
            if tried.cost > rows.cost:
                break
            rows, self._shift = tried, self._shift + move
            if np.abs(move / self._sd).max() < _SETTLED:
                break
        stacked = np.concatenate([rows.by_node, rows.jacobian, rows.residual[:, None]], axis=1)
        nodes = self._sd.size
        upper = np.asarray(np.linalg.qr(stacked, mode="r"))
        left = upper[nodes:, nodes:]
        return left[:, -1], left[:, :-1]

    def _rows(self, x: Array, shift: Array) -> "_Rows":
        """Return the rows for readings and nodes at x, with nodes changed by `shift`, K."""
        model = self._model._replace(node_shift=shift)
        residual, jacobian = model.linearise(x)
        effect = model.node_effect(x)
        if self._white:
            by_node = [
                (diagonal * model.slope(x, k))[:, None] * effect
                for k, diagonal in enumerate(self._diagonals)
            ]
        else:
            by_node = [
                whitening @ (model.slope(x, k)[:, None] * effect)
                for k, whitening in enumerate(model.whitening)
            ]
        known = np.diag(1 / self._sd)
        return _Rows(
            np.concatenate([residual, -shift / self._sd]),
            np.concatenate([jacobian, np.zeros((shift.size, x.size))]),
            np.concatenate([*by_node, known]),
        )

"""Test a sensor by a table of inputs and readings, on plain arrays.

The definitions are those of IEEE Std 528. K is the slope of the straight line y = c + K x, which is
fitted by least squares with equal weights to all rows; full scale is the largest input.

* linearity error: the largest residual of the line, divided by K times full scale;
* asymmetry: the difference between the slopes of both senses, each with the rests, divided by their
  mean;
* composite error: the largest difference between a reading and the nominal output, divided by half
  the span of the output;
* hysteresis: the separation of the readings at the same input that was reached from a higher and
  from a lower input, in the middle of the loop::

      y = level(x) − ½ s h (1 − u²),     s = ±1 for a rising or falling input, u = −1 … 1

  The loop closes at its ends. Each input has its own level, so nonlinearity has no effect.

The covariance of the readings includes the errors of the bench, so its hysteresis, its settling and
the errors of its inputs are nuisances of every estimate. Effects of other inputs, such as the
g-sensitivity of a gyro that is turned over, are fitted together with the line and subtracted. The
hysteresis does not depend on them, because they are the same at equal levels.

An effect is detected if it is three standard uncertainties from zero. Otherwise its upper limit at
95 % is stated. If χ² of the hysteresis is improbably large, its uncertainty is enlarged to make it
probable (Birge). `inercal.estimation.response_band` has the tests with small inputs.
"""

# pyright: reportMissingTypeStubs=false
from dataclasses import dataclass, replace
from functools import cached_property
from math import nan, sqrt

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError

DETECTED = 3.0  # standard uncertainties
CHANCE = 0.0027  # probability of 3 standard deviations
_BIRGE = 0.01
_INTERVAL, _BOUND = 1.959964, 1.644854  # normal quantiles at 97.5 and 95 %
_NO_EFFECT = 1e-6  # of the largest effect of another input
_REST = 1e-3  # times full scale: a slower or smaller input is zero


@dataclass(frozen=True, eq=False)
class InputOutput:
    """Inputs and readings of one axis in the order of measurement.

    Parameters
    ----------
    x, y : (n,) array
        Inputs and readings in the same SI unit.
    covariance : (n, n) array
        Covariance of the readings, including the errors of the inputs.
    errors : (n, n) array
        The part of the covariance that is due to the errors of the inputs.
    rising : (n,) array
        1 if the input was reached from a lower one, −1 from a higher one, 0 if it is unknown.
    level : (n,) array of int
        Rows with the same number have the same input, and the same bias.
    setting : (n,) array of int
        Rows with the same number have the same bias.
    others : (n, q) array or None
        Readings due to q other inputs of unit size, each the same at equal levels.

    Raises
    ------
    InputError
        The arrays do not fit, or the covariance is not positive definite.
    """

    x: Array
    y: Array
    covariance: Array
    errors: Array
    rising: Array
    level: Indices
    setting: Indices
    others: Array | None = None

    def __post_init__(self) -> None:
        n = len(self.x)
        sizes = [len(one) for one in (self.y, self.rising, self.level, self.setting)]
        if sizes != [n] * 4 or self.covariance.shape != (n, n):
            raise InputError(f"inputs and readings have {n} and {sizes} rows; give equal numbers")
        if n and np.linalg.eigvalsh(self.covariance)[0] <= 0:
            raise InputError("the covariance of the readings is not positive definite")

    def rows(self, which: Indices) -> "InputOutput":
        """Return only these rows."""
        return InputOutput(
            self.x[which],
            self.y[which],
            self.covariance[np.ix_(which, which)],
            self.errors[np.ix_(which, which)],
            self.rising[which],
            self.level[which],
            self.setting[which],
            None if self.others is None else self.others[which],
        )

    @cached_property
    def alone(self) -> tuple[Array, Array, Array]:
        """Readings without the `others`, their covariance, and the design that was fitted."""
        line = np.stack([np.ones_like(self.x), self.x / self.full_scale], axis=-1)
        if self.others is None:
            return self.y, self.covariance, line
        others: Array = self.others / np.maximum(np.abs(self.others).max(axis=0), _NO_EFFECT)
        free: Array = others - line @ np.linalg.pinv(line) @ others
        shown = np.abs(free).max(axis=0) > _NO_EFFECT  # the rest acts like the line
        inverse = np.asarray(np.linalg.pinv(free[:, shown], rcond=_NO_EFFECT), float)
        keep: Array = np.eye(len(self.x)) - np.matmul(others[:, shown], inverse)
        return keep @ self.y, keep @ self.covariance @ keep.T, np.c_[line, free[:, shown]]

    def whiten(self, columns: Array) -> Array:
        """Return columns, (n, k), in units in which the covariance of the readings is 1."""
        return np.linalg.inv(np.linalg.cholesky(self.covariance)) @ columns

    @property
    def full_scale(self) -> float:
        """The largest input."""
        return float(np.abs(self.x).max())


@dataclass(frozen=True)
class Figure:
    """The value of an effect and its uncertainty.

    Parameters
    ----------
    value, u : float
        Value and standard uncertainty.
    low, high : float
        Interval that contains the effect with a probability of 95 %.
    detected : bool
        Whether the effect differs significantly from zero.
    bound : float
        Upper limit of the effect's size at 95 %.
    detectable : float
        Size of an effect that these data would just detect; NaN if it is not known.
    """

    value: float
    u: float
    low: float
    high: float
    detected: bool
    bound: float
    detectable: float


def _figure(value: float, u: float, *, tested: bool = True) -> Figure:
    return Figure(
        value,
        u,
        value - _INTERVAL * u,
        value + _INTERVAL * u,
        not tested or abs(value) >= DETECTED * u,
        abs(value) + _BOUND * u,
        DETECTED * u if tested else nan,
    )


def probability_above(chi2: float, dof: int) -> float:
    """Return the probability of a larger χ²."""
    from scipy.special import chdtrc  # a refused run file does not load scipy

    return float(chdtrc(dof, chi2)) if dof > 0 else 1.0


def enlargement(chi2: float, dof: int) -> float:
    """Return the factor by which an improbable χ² enlarges the uncertainties."""
    if chi2 <= dof or probability_above(chi2, dof) >= _BIRGE:  # χ² may be below zero by rounding
        return 1.0
    return sqrt(chi2 / dof)


def _line_gain(x: Array) -> Array:
    """Return the matrix that turns readings into offset and slope of their line, (2, n)."""
    off = x - x.mean()
    slope = off / float(off @ off)
    return np.stack([np.full_like(x, 1 / len(x)) - float(x.mean()) * slope, slope])


def scale_factor(table: InputOutput) -> Figure:
    """Return the slope K of the straight line; it is not tested against zero."""
    gain, (y, covariance, _) = _line_gain(table.x)[1], table.alone
    return _figure(float(gain @ y), sqrt(float(gain @ covariance @ gain)), tested=False)


def line_residuals(table: InputOutput) -> tuple[Array, Array]:
    """Return the residuals of the straight line and their covariance, divided by K full scale."""
    design = np.stack([np.ones_like(table.x), table.x], axis=-1)
    gain, (y, covariance, _) = _line_gain(table.x), table.alone
    away = np.eye(len(table.x)) - design @ gain
    size = abs(float(gain[1] @ y)) * table.full_scale
    return away @ y / size, away @ covariance @ away.T / size**2


def linearity_error(table: InputOutput) -> Figure:
    """Return the linearity error.

    It is detected if a line does not fit within the errors, and if its interval excludes zero.
    """
    residual, spread = line_residuals(table)
    worst = int(np.argmax(np.abs(residual)))
    off = table.whiten(np.c_[table.alone[2], table.y])
    fitted, _, rank, _ = np.linalg.lstsq(off[:, :-1], off[:, -1])
    chi2 = float(np.sum((off[:, -1] - off[:, :-1] @ fitted) ** 2))
    found = _figure(abs(float(residual[worst])), sqrt(float(spread[worst, worst])))
    shown = found.low > 0 and probability_above(chi2, len(table.x) - int(rank)) < CHANCE
    return replace(found, detected=shown, detectable=nan)


def composite_error(table: InputOutput) -> Figure:
    """Return the composite error from the nominal output; it is not tested against zero."""
    y, covariance, _ = table.alone
    span = float(np.ptp(y)) / 2
    off = np.abs(y - table.x) / span
    worst = int(np.argmax(off))
    return _figure(float(off[worst]), sqrt(covariance[worst, worst]) / span, tested=False)


def asymmetry(table: InputOutput) -> Figure | None:
    """Return the asymmetry, or None if there is only one sense."""
    full = table.full_scale
    zero = np.abs(table.x) <= _REST * full
    gains: list[Array] = []
    for side in ((table.x > 0) | zero, (table.x < 0) | zero):
        if len(set((table.x[side] / full).round(2).tolist())) < 2:
            return None
        gain = np.zeros_like(table.x)
        gain[side] = _line_gain(table.x[side])[1]
        gains.append(gain)
    y, covariance, _ = table.alone
    mean = float((gains[0] + gains[1]) @ y) / 2
    difference = (gains[0] - gains[1]) / mean
    return _figure(float(difference @ y), sqrt(float(difference @ covariance @ difference)))


def loop_shape(table: InputOutput) -> Array:
    """Return −½ s (1 − u²) of each row in the loop of its setting, (n,)."""
    shape = np.zeros_like(table.x)
    for setting in np.unique(table.setting):
        own = table.setting == setting
        low, high = table.x[own].min(), table.x[own].max()
        if high > low:
            u = (2 * table.x[own] - low - high) / (high - low)
            shape[own] = -0.5 * table.rising[own] * (1 - u**2)
    return shape


def has_both_senses(table: InputOutput) -> bool:
    """Return whether an input inside a loop was reached from both sides."""
    shape = loop_shape(table)
    shape = np.where(np.abs(shape) < _REST, 0.0, shape)
    return any(np.ptp(np.sign(shape[table.level == level])) > 1 for level in np.unique(table.level))


def hysteresis(table: InputOutput) -> Figure | None:
    """Return the hysteresis, or None if no input was reached from both sides."""
    if not has_both_senses(table):
        return None
    levels = (table.level[:, None] == np.unique(table.level)).astype(float)
    white = table.whiten(np.c_[levels, loop_shape(table), table.y])
    basis = np.linalg.qr(white[:, :-2])[0]
    own, read = (white[:, k] - basis @ (basis.T @ white[:, k]) for k in (-2, -1))
    information = float(own @ own)
    value = float(own @ read) / information
    chi2 = float(read @ read) - information * value**2
    wider = enlargement(chi2, len(table.x) - levels.shape[1] - 1)
    return _figure(value, wider / sqrt(information))

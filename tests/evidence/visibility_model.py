"""Calibrations as arrays, to say how visible a violation is: nothing of inercal is imported.

A calibration reads y = h(x) + noise. Unknown x are the coefficients that are estimated, errors of
the bench within a stated standard deviation, and whatever is open altogether. With rows over their
noise, and a row x/sd for each that has a stated deviation, J are the derivatives by x. A violation
of size s adds c s to the readings, of which the estimator takes up a part and leaves another::

    shift of x = J⁺ c s        η = |(I − J J⁺) c s|

η is the norm of the residual that the violation leaves: χ² becomes noncentral by η², and no test of
these readings sees more of it.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Values = Mapping[str, float]
Files = Mapping[str, str | bytes]
Role = Literal["coefficient", "bench", "open"]
G0 = 9.80665  # m/s², exact (CGPM 1901)
_STEPS, _CLOSE = 20, 1e-3  # of the search for a size
_OPEN = 1e-9  # least share of a column that counts as seen


@dataclass(frozen=True)
class Unknown:
    """A quantity that is estimated.

    Parameters
    ----------
    sd : float
        Standard deviation with which it is drawn, SI; of the bench, what the run file states.
    role : "coefficient", "bench" or "open"
        Whether its error counts, it is within what is stated, or nothing is known of it.
    known : bool
        Whether the run file states a prior of a coefficient: 0 ± sd.
    """

    sd: float
    role: Role = "bench"
    known: bool = False


@dataclass(frozen=True)
class Violation:
    """Something that the calibration's model leaves out or takes as known.

    Parameters
    ----------
    name : str
        What it is, in words.
    unit : str
        Of its size.
    si : float
        One unit, SI.
    change : mapping of str to float
        By how much quantities of the case change for each unit of SI.
    suspects : tuple of str
        What a score test may call it: each is the true cause.
    most : float
        Size in `unit` beyond which nobody would need a test to notice it.
    gross : callable or None
        What it does to readings (..., m), for mistakes without a size.
    counted : str
        Where the data cannot show it: what counts it in U, or what the report prints.
    symmetric : bool
        Of a mistake without a size: whether the readings are those of another device, exactly.
    followed : bool
        Whether an estimator follows it beyond the first order, so that only this counts.
    limit : str
        Where no key of the run file counts it in U: the word that the verdict's limitations have
        for it.
    """

    name: str
    unit: str = ""
    si: float = 1.0
    change: Values = field(default_factory=dict[str, float])
    suspects: tuple[str, ...] = ()
    most: float = np.inf
    gross: Callable[[Array], Array] | None = None
    counted: str = ""
    symmetric: bool = False
    followed: bool = False
    limit: str = ""


@dataclass(frozen=True)
class Visibility:
    """What a violation does.

    Parameters
    ----------
    eta : float
        Norm of the residual that one unit leaves, to first order.
    shift : float
        Largest shift of a coefficient by one unit over its standard uncertainty, to first order.
    coefficient : str
        Which one that is.
    left : (m,) array
        The residual itself.
    at_five : float
        Size at which a coefficient is shifted by 5 u; infinite if none within reach does.
    at_six : float
        Size at which η is 6; infinite if none within reach does.
    eta_at_five : float
        η at the size that shifts a coefficient by 5 u.
    """

    eta: float
    shift: float
    coefficient: str
    left: Array
    at_five: float
    at_six: float
    eta_at_five: float


@dataclass(frozen=True, eq=False)
class Case:
    """A method with a device, a bench and data, as drawn and as stated.

    Parameters
    ----------
    method : str
    unknowns : mapping of str to Unknown
        By name; coefficients are named as in inercal, and in SI.
    readings : callable
        Returns noise-free readings, (m,), of quantities by name; those missing are zero.
    noise : (m,) array
        Standard deviation of each reading, or (m, m) their covariance.
    violations : tuple of Violation
    files : callable
        Returns the files of one run, by name, from quantities, a source of chance, and what a gross
        violation does: the run file is "run.toml".
    shape : tuple of int
        Rows and channels of the readings, (r, channels), as a gross violation takes them.
    rows : tuple of str
        What inercal calls the rows, (r,).
    rivals : mapping of str to tuple of str
        Further quantities that could be the cause, together, by the name of a suspect.
    """

    method: str
    unknowns: Mapping[str, Unknown]
    readings: Callable[[Values], Array]
    noise: Array
    violations: tuple[Violation, ...]
    files: Callable[[Values, np.random.Generator, Violation | None], Files]
    shape: tuple[int, ...] = ()
    rows: tuple[str, ...] = ()
    rivals: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Return quantities of one device on one bench."""
        return {name: one.sd * rng.standard_normal() for name, one in self.unknowns.items()}

    @property
    def coefficients(self) -> tuple[str, ...]:
        return tuple(n for n, one in self.unknowns.items() if one.role == "coefficient")

    @cached_property
    def white(self) -> Array:
        """What brings readings to unit covariance: (m,) factors, or the inverse of a factor."""
        if self.noise.ndim == 1:
            return 1 / self.noise
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.noise)), dtype=float)

    def _whitened(self, rows: Array) -> Array:
        return rows * self.white if self.white.ndim == 1 else self.white @ rows

    def column(self, change: Values, step: float) -> Array:
        """Return the derivative of whitened readings along a change, (m,)."""
        ahead = self.readings({n: step * c for n, c in change.items()})
        behind = self.readings({n: -step * c for n, c in change.items()})
        return self._whitened((ahead - behind) / (2 * step))

    @cached_property
    def _factor(self) -> tuple[Array, Array, Array]:
        """Return Q and R⁻¹ of J, scaled back to SI, and the standard uncertainties, (p,)."""
        names = list(self.unknowns)
        stated = [n for n in names if (one := self.unknowns[n]).role == "bench" or one.known]
        columns = [self.column({n: 1.0}, self.unknowns[n].sd) for n in names]
        below = np.zeros((len(stated), len(names)))
        for k, name in enumerate(stated):
            below[k, names.index(name)] = 1 / self.unknowns[name].sd
        jacobian = np.concatenate([np.stack(columns, axis=1), below])
        length = np.linalg.norm(jacobian, axis=0)
        u, s, v = np.linalg.svd(jacobian / length, full_matrices=False)
        if s[-1] < _OPEN * s[0]:
            raise ValueError(f"{self.method}: the unknowns are not observed")
        back = (v.T / s) / length[:, None]
        return u, back, np.linalg.norm(back, axis=1)

    @property
    def uncertainty(self) -> dict[str, float]:
        """Standard uncertainty of each unknown, SI."""
        return dict(zip(self.unknowns, self._factor[2].tolist(), strict=True))

    def visibility(self, violation: Violation) -> Visibility:
        """Return what a violation does: one unit to first order, and the sizes of 5 u and η = 6.

        The violation itself need not act in proportion to its size; what the fit takes up of it is
        that of the linear problem.
        """
        q, back, sd = self._factor
        names = list(self.unknowns)
        step = min((self.unknowns[n].sd for n in violation.change if n in names), default=None)
        step = step or min(violation.most * violation.si * 1e-3, 1e-3)
        column = self.column(violation.change, step) * violation.si
        column = np.concatenate([column, np.zeros(len(q) - len(column))])
        taken = q.T @ column
        left = column - q @ taken
        left -= q @ (q.T @ left)
        eta = float(np.linalg.norm(left))
        if eta < 1e-7 * np.linalg.norm(column):
            eta = 0.0  # rounding of differences
        shift = np.abs(back @ taken) / sd
        # A violation of a coefficient that is estimated is none: it moves what is to be found.
        own = [k for k, n in enumerate(names) if self.unknowns[n].role == "coefficient"]
        worst = max(own, key=lambda k: float(f"{shift[k]:.9g}"))  # of equal ones the first
        most = float(shift[worst])
        plain = self._whitened(self.readings({}))

        def effect(size: float) -> tuple[float, float]:
            """Return η and the largest shift in u of a size."""
            values = {n: size * violation.si * c for n, c in violation.change.items()}
            change = np.zeros(len(q))
            change[: plain.size] = self._whitened(self.readings(values)) - plain
            into = q.T @ change
            rest = float(np.linalg.norm(change - q @ into))
            return rest, float(np.max((np.abs(back @ into) / sd)[own]))

        def reached(target: float, first: float, which: int) -> float:
            """Return the size of a target, infinite where none within reach has it."""
            size = target / first if first > 0 else np.inf
            for _ in range(0 if violation.followed else _STEPS):
                if not size <= violation.most or np.isinf(size):
                    return np.inf
                ratio = target / effect(size)[which]
                size *= ratio
                if abs(ratio - 1) < _CLOSE:
                    break
            return size if size <= violation.most else np.inf

        five, six = reached(5.0, most, 1), reached(6.0, eta, 0)
        there = effect(five)[0] if np.isfinite(five) else np.inf
        there = eta * five if violation.followed else there
        there = 0.0 if eta == 0 else there
        return Visibility(eta, most, names[worst], left, five, six, there)

    def eta_of_gross(self, violation: Violation) -> float:
        """Return η of a mistake without a size, by the linear model: where large, only that."""
        assert violation.gross is not None
        if violation.symmetric or violation.change or not self.shape:
            return 0.0 if violation.symmetric else np.nan
        plain = self.readings({})
        changed = violation.gross(plain.reshape(self.shape)).ravel()
        q = self._factor[0]
        column = np.zeros(len(q))
        column[: plain.size] = self._whitened(changed - plain)
        left = column - q @ (q.T @ column)
        eta = float(np.linalg.norm(left))
        return eta if eta > 1e-6 * np.linalg.norm(column) else 0.0

    @cached_property
    def spaces(self) -> dict[str, Array]:
        """Return what each rival may leave: an orthonormal basis (m, k) by name."""
        q = self._factor[0]
        made: dict[str, Array] = {}
        if self.rows:
            r, channels = self.shape
            for k, name in enumerate(self.rows):
                columns = np.zeros((r * channels, channels))
                columns[k * channels : (k + 1) * channels] = np.eye(channels)
                made[name] = self._whitened(columns.T).T if self.white.ndim == 1 else columns
        for name, members in self.rivals.items():
            made[name] = np.stack([self.column({one: 1.0}, 1e-4) for one in members], axis=1)
        bases: dict[str, Array] = {}
        for name, columns in made.items():
            padded = np.zeros((len(q), columns.shape[1]))
            padded[: len(columns)] = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
            left = padded - q @ (q.T @ padded)
            u, s, _ = np.linalg.svd(left, full_matrices=False)
            if np.any(s > 1e-6):
                bases[name] = u[:, s > 1e-6]
        return bases

    def sized(self) -> Iterator[tuple[Violation, Visibility]]:
        """Yield the violations that have a size, with what one unit of each does."""
        for violation in self.violations:
            if violation.gross is None:
                yield violation, self.visibility(violation)


def angle_to_space(one: Visibility, basis: Array) -> float:
    """Return the angle between what a violation leaves and a space of residuals (m, k), °."""
    if one.eta == 0:
        return 90.0
    inside = float(np.linalg.norm(basis.T @ one.left)) / one.eta
    return float(np.degrees(np.arccos(min(1.0, inside))))


def angle(one: Visibility, other: Visibility) -> float:
    """Return the angle between what two violations leave, °; 90 where one leaves nothing."""
    product = one.eta * other.eta
    if product == 0:
        return 90.0
    return float(np.degrees(np.arccos(min(1.0, abs(one.left @ other.left) / product))))

"""Constants of a bench without "±": what their assumed uncertainty does to the result.

Half a unit of the last digit is taken (`inercal.units.parse_quantity`). The part of it in u of a
coefficient is what u loses when the constant is taken as exact::

    part² = u² − u²(exact)

Where the part is larger than the rest, the assumption would make the result: the run is refused.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from inercal.arrays import Array
from inercal.benches import Bench
from inercal.errors import InputError
from inercal.estimate import Estimate
from inercal.parameters import Parameter
from inercal.units import Measured, format_quantity, format_value_and_uncertainty, si_factor

_UNITS = {  # to print in, by key
    "gravity": "m/s²",
    "latitude": "°",
    "radius": "m",
    "stretch": "ppm/g",
    "azimuth": "°",
    "latency": "ms",
}


@dataclass(frozen=True)
class AssumedConstant:
    """A constant without "±".

    Parameters
    ----------
    key : str
        In [bench].
    words : str
        Key, value and the u that is taken.
    names : tuple of str
        Of its parameters.
    """

    key: str
    words: str
    names: tuple[str, ...]


def find_assumed_constants(
    bench: Bench, expected: Mapping[str, Parameter]
) -> tuple[AssumedConstant, ...]:
    """Return the constants of a bench without "±" among the parameters that act."""
    by_key: dict[str, list[str]] = {}
    for name, parameter in expected.items():
        if parameter.assumed:
            by_key.setdefault(parameter.assumed, []).append(name)
    return tuple(
        AssumedConstant(key, _describe_constant(bench, key), tuple(names))
        for key, names in by_key.items()
    )


def _describe_constant(bench: Bench, key: str) -> str:
    found: Measured | tuple[Measured, ...] = getattr(bench, key)
    several = (found,) if isinstance(found, Measured) else found
    wide = max((one for one in several if one.assumed), key=lambda one: one.sd)
    unit = _UNITS[key]
    u = format_value_and_uncertainty(0.0, wide.sd / si_factor(unit))[1]
    return (
        f"{key} {format_quantity(wide.value, 0.0, unit)} is stated without ±: half a unit of its "
        f"last digit is taken, u = {u} {unit}"
    )


def constant_notes(constants: Sequence[AssumedConstant]) -> tuple[str, ...]:
    """Return a line for each constant that says what was taken."""
    return tuple(f"{one.words}; state ± to replace it" for one in constants)


def require_small_assumed_share(
    constants: Sequence[AssumedConstant],
    estimate: Estimate,
    count: int,
    bench: Bench,
    solve: Callable[[Bench], Estimate],
) -> None:
    """Refuse an assumed uncertainty that is the larger part of u of a coefficient.

    Parameters
    ----------
    constants : sequence of AssumedConstant
    estimate : Estimate
        Its first `count` parameters are the sensor's coefficients.
    count : int
    bench : Bench
    solve : callable
        The estimate on another bench; called where a constant is not a parameter of the estimate.

    Raises
    ------
    InputError
        Naming the key, the coefficient and the share.
    """
    whole = np.diagonal(estimate.covariance)[:count]
    for one in constants:
        if all(name in estimate.names for name in one.names):
            part = _variance_part(estimate, count, one.names)
        else:
            exact = solve(_with_exact_constant(bench, one.key))
            part = np.maximum(whole - np.diagonal(exact.covariance)[:count], 0.0)
        rest = np.maximum(whole - part, 0.0)
        if not (part > rest).any():
            continue
        k = int(np.argmax(part / np.where(whole > 0, whole, np.inf)))
        share = 100 * float(np.sqrt(part[k] / whole[k]))
        raise InputError(
            f"[bench] {one.words}; that would be {share:.0f} % of u of {estimate.names[k]}, more "
            "than all the rest: state its ±, or ± 0 where it is exact"
        )


def _variance_part(estimate: Estimate, count: int, names: Sequence[str]) -> Array:
    """Return the part of each variance that goes when these parameters are exact, (count,)."""
    at = [estimate.names.index(name) for name in names]
    own = estimate.covariance[np.ix_(at, at)]
    cross = estimate.covariance[:count, at]
    return np.einsum("ij,jk,ik->i", cross, np.linalg.pinv(own, hermitian=True), cross)


def _with_exact_constant(bench: Bench, key: str) -> Bench:
    """Return the bench with the constants of a key exact."""
    stated: Measured | tuple[Measured, ...] = getattr(bench, key)
    if isinstance(stated, Measured):
        exact: Any = replace(stated, sd=0.0)
    else:
        exact = tuple(replace(one, sd=0.0) for one in stated)
    return replace(bench, **{key: exact})

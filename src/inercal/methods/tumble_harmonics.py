"""Find which coefficients the harmonics of a tumble test contain, and which harmonics fold.

At n evenly spaced positions θ = θ₀ + 2πk/n the columns 1, sin hθ, cos hθ are orthogonal if
n ≥ 2m + 1 for the highest harmonic m (IEEE Std 1293), and amplitudes are simple sums::

    A₀ = Σ y / n,   S_h = 2 Σ y sin hθ / n,   C_h = 2 Σ y cos hθ / n

With fewer positions harmonic h cannot be separated from harmonic n − h. Harmonic n/2 retains only
one of its two phases, and its divisor is the sum of squares of that column instead of n/2.
Positions that are visited equally often (a turn forward and a turn back) do not change this.
"""

from collections.abc import Sequence
from math import ceil, degrees, pi

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.basics.errors import InputError, NotObserved
from inercal.estimation.nullspace import undetermined_combinations
from inercal.methods.observability import direction_in_words
from inercal.physics.motion import Motion
from inercal.physics.sensors import G0, Sensor

TERMS = ("k0", "k1", "delta_o", "k2", "kip", "k3")
_HARMONIC_OF_TERM = {"k0": "A0", "k1": "S1", "delta_o": "C1", "k2": "C2", "kip": "S2", "k3": "S3"}
_HIGHEST_HARMONIC = 3
_ANGLE_TOLERANCE = 1e-9  # rad; equal nominal angles differ only by rounding


def harmonic_names(terms: Sequence[str]) -> tuple[str, ...]:
    """Return the harmonic that determines each term, such as "S1" for "k1" and "C2" for "k2"."""
    return tuple(_HARMONIC_OF_TERM[term] for term in terms)


def harmonic_basis(angle: Array, names: Sequence[str]) -> Array:
    """Return the columns of these harmonics at r angles, rad: (r, q)."""
    one = {"A": np.ones_like, "S": np.sin, "C": np.cos}
    return np.stack([one[name[0]](int(name[1]) * angle) for name in names], axis=-1)


def amplitude_map(terms: Sequence[str], g: float) -> tuple[Array, Array]:
    """Return the map from amplitudes to coefficients, (p, p), and the constant to add, (p,).

    Amplitudes are in m/s², in the order of `harmonic_names`; coefficients are in SI. Terms that are
    not listed are assumed to be zero.
    """
    k2 = -2 / g**2
    k3 = -4 / g**3
    rows = {
        "k0": {"A0": 1.0} | ({"C2": -k2 * g**2 / 2} if "k2" in terms else {}),
        "k1": {"S1": 1 / g} | ({"S3": -k3 * 0.75 * g**2} if "k3" in terms else {}),
        "delta_o": {"C1": 1 / g},
        "k2": {"C2": k2},
        "kip": {"S2": 2 / g**2},
        "k3": {"S3": k3},
    }
    columns = harmonic_names(terms)
    matrix = np.array([[rows[term].get(name, 0.0) for name in columns] for term in terms])
    return matrix, np.array([-1.0 if term == "k1" else 0.0 for term in terms])


def confounded_columns(matrix: Array) -> Bools:
    """Return which columns of a basis, (r, q), vanish or are not orthogonal to the others, (q,)."""
    gram = matrix.T @ matrix / len(matrix)
    off = np.abs(gram - np.diag(np.diagonal(gram))) > _ANGLE_TOLERANCE
    return off.any(axis=0) | (np.diagonal(gram) < _ANGLE_TOLERANCE)


def distinct_angles(angle: Array) -> tuple[Array, Indices]:
    """Return the distinct angles within one turn, rad, ascending, and the number of visits to each.

    Parameters
    ----------
    angle : (r,) array
        Angles in any turn, rad.
    """
    # An angle that is below a whole turn by rounding is angle 0.
    within = np.sort(np.mod(angle + _ANGLE_TOLERANCE / 2, 2 * pi) - _ANGLE_TOLERANCE / 2)
    first = np.flatnonzero(np.diff(within, prepend=-np.inf) > _ANGLE_TOLERANCE)
    return within[first], np.diff(first, append=len(within))


def unevenness(angle: Array) -> str:
    """Describe where angles, (r,) rad, are not evenly spaced or visited; empty if they are even."""
    at, visits = distinct_angles(angle)
    gaps = np.diff(at, append=at[0] + 2 * pi)
    worst = int(np.argmax(gaps))
    even = 2 * pi / len(at)
    if gaps[worst] - even > len(at) * _ANGLE_TOLERANCE:
        return (
            f"the position after {degrees(at[worst]):.6g}° is {degrees(gaps[worst]):.6g}° "
            f"away instead of the {degrees(even):.6g}° between {len(at)} even positions"
        )
    if visits.min() != visits.max():
        most, least = int(visits.argmax()), int(visits.argmin())
        return (
            f"{degrees(at[most]):.6g}° was visited {visits[most]} times and "
            f"{degrees(at[least]):.6g}° {visits[least]} times"
        )
    return ""


def require_even_spacing(angle: Array) -> None:
    """Raise InputError if positions are not evenly spaced on the circle or not visited equally.

    Raises
    ------
    InputError
        The message says where the positions are uneven.
    """
    if words := unevenness(angle):
        raise InputError(
            "estimator fourier needs positions evenly spaced around the circle, each visited "
            f"as often as the others, but {words}; use estimator least_squares",
            key="steps",
        )


def folded_harmonics(angle: Array) -> tuple[str, ...]:
    """Return as text which harmonics up to the third fold onto which lower ones.

    The result is empty if no harmonic folds. It is also empty if positions are not evenly spaced,
    because then no harmonic folds exactly.

    Examples
    --------
    >>> folded_harmonics(np.arange(4) * pi / 2)
    ('harmonic 2 folds onto itself: its sine is not seen', 'harmonic 3 folds onto harmonic 1')
    """
    at, _ = distinct_angles(angle)
    n = len(at)
    if unevenness(at):
        return ()
    folded: list[str] = []
    for h in range(ceil(n / 2), _HIGHEST_HARMONIC + 1):
        if 2 * h > n:
            folded.append(f"harmonic {h} folds onto harmonic {n - h}")
            continue
        sine, cosine = abs(np.sin(h * at[0])), abs(np.cos(h * at[0]))
        lost = "its sine and cosine are not separated"
        if min(sine, cosine) < h * _ANGLE_TOLERANCE:
            lost = f"its {'sine' if sine < cosine else 'cosine'} is not seen"
        folded.append(f"harmonic {h} folds onto itself: {lost}")
    return tuple(folded)


def require_distinct_harmonics(
    sensor: Sensor, terms: Sequence[str], matrix: Array, angle: Array
) -> None:
    """Raise NotObserved if harmonics of the terms, columns of `matrix`, fold onto one another.

    Raises
    ------
    NotObserved
        The same as for `not_observed_error`.
    """
    lost = confounded_columns(matrix)
    if not lost.any():
        return
    to_term, _ = amplitude_map(terms, G0)
    touched = (to_term[:, lost] != 0).any(axis=1)
    names = [name for name, hit in zip(sensor.coefficients, touched, strict=True) if hit]
    f = G0 * np.stack([np.sin(angle), np.cos(angle), np.zeros_like(angle)], axis=-1)
    design = sensor.design(Motion(f), np.zeros(len(terms)))[:, 0] * sensor.unit_scale
    _, size, right = np.linalg.svd(design)
    free = right[int(np.sum(size > 1e-9 * size[0])) :]
    directions = [direction_in_words(row, sensor.coefficients) for row in free]
    raise not_observed_error(
        sensor, directions, angle, "use estimator least_squares with a prior", names
    )


def not_observed_error(
    sensor: Sensor, directions: Sequence[str], angle: Array, remedy: str, names: Sequence[str] = ()
) -> NotObserved:
    """Return an error with the undetermined coefficients and combinations, and folded harmonics.

    Parameters
    ----------
    sensor : Sensor
    directions : sequence of str
        Combinations of coefficients in natural units, in words.
    angle : (r,) array
        Angles of the positions, rad.
    remedy : str
        Remedy to state in addition to fewer coefficients and more positions.
    names : sequence of str
        Coefficients to name in addition to those in the directions.
    """
    plain = tuple(words.partition(" (in units")[0] for words in directions)
    touched = {word for words in plain for word in words.replace("−", " ").split()} | set(names)
    named = tuple(name for name in sensor.coefficients if name in touched)
    free = f" {undetermined_combinations(plain, 'g and rad')}" if plain else ""
    folded = folded_harmonics(angle)
    n = len(distinct_angles(angle)[0])
    why = f". With {n} positions {'; '.join(folded)}; use 7 positions or more" if folded else ""
    also = ", or" if folded else ";"
    return NotObserved(
        f"these positions do not determine {', '.join(named)}{why}{also} choose fewer "
        f"coefficients or {remedy}{free}",
        plain,
        names=named,
    )


def folding_notes(angle: Array) -> tuple[str, ...]:
    """Return a note on coefficients that were not selected, if harmonics fold."""
    folded = folded_harmonics(angle)
    if not folded:
        return ()
    n = len(distinct_angles(angle)[0])
    return (
        f"With {n} positions {'; '.join(folded)}. Coefficients that are not estimated may "
        "therefore distort those that are.",
    )

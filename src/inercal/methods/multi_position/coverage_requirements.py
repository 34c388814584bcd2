"""Refusal of rests and turns that do not determine the coefficients.

A combination of coefficients is not observed where the errors of a geometry
(`attitude_coverage.GeometryErrors`) would shift it by a tenth of its natural size (10 % of scale,
0.1 g of bias, 0.1 rad).
"""

from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import NotObserved
from inercal.estimation import Gaussian
from inercal.methods.multi_position.attitude_coverage import GeometryErrors, next_attitudes
from inercal.methods.multi_position.rest_observations import Rests
from inercal.methods.observability import OBSERVABILITY_LIMIT, direction_in_words
from inercal.physics.plan import Hold
from inercal.physics.sensors import G0

_COVERED_COSINE = np.cos(np.pi / 4)  # a rest within 45° of an axis counts for it
_TARGET_DEVIATION = 0.01  # of the natural size: what to add is named until the geometry gives this


def require_coverage(rests: Rests, priors: Sequence[Gaussian]) -> None:
    """Refuse attitudes and turns that do not determine the coefficients.

    Raises
    ------
    NotObserved
        Naming coefficients, free directions, the axes that no rest had up, and what to add.
    """
    sensor, p, a = rests.sensor, len(rests.sensor.coefficients), len(rests.force.coefficients)
    information = geometry_information(rests, priors)
    free: list[Array] = []
    for part in (slice(0, a), slice(a, p)):
        if information[part, part].size:
            values, vectors = np.linalg.eigh(information[part, part])
            for vector in vectors[:, values < OBSERVABILITY_LIMIT**-2].T:
                whole = np.zeros(p)
                whole[part] = vector
                free.append(whole)
    if not free:
        return
    words = tuple(direction_in_words(row, sensor.coefficients) for row in free)
    touched = {word for text in words for word in text.split()}
    named = tuple(name for name in sensor.coefficients if name in touched)
    ups = rests.norms(rests.start()).up
    more, _ = next_attitudes(
        sensor,
        information,
        ups[-1],
        G0,
        GeometryErrors(),
        target_deviation=_TARGET_DEVIATION,
        max_attitudes=_attitude_count(len(ups), a),
    )
    raise NotObserved(
        f"not observed: {', '.join(named)} (free directions, in units of g and rad/s: "
        f"{'; '.join(words)}); {_coverage_gaps(rests, ups)}; add: {attitudes_in_words(more)}",
        words,
        names=named,
    )


def geometry_information(rests: Rests, priors: Sequence[Gaussian]) -> Array:
    """Return the information matrix of rests and turns under the geometry's own errors, (p, p).

    In natural sizes, at the nominal model; accelerometers and gyros by themselves.
    """
    p, a = len(rests.sensor.coefficients), len(rests.force.coefficients)
    rows = rests.rows(rests.start())
    r, k = len(rows.norm.residual), 0 if rows.rotations is None else len(rows.rotations.residual)
    errors = GeometryErrors()
    counts = [r, 2 * k, len(rows.residual) - r - 2 * k]
    size = np.repeat([errors.norm, errors.turn, errors.rate], counts)
    jacobian = rows.jacobian[:, :p] / size[:, None] * rests.sensor.unit_scale
    information = np.zeros((p, p))
    for part, of in ((slice(0, a), slice(0, r)), (slice(a, p), slice(r, None))):
        information[part, part] = jacobian[of, part].T @ jacobian[of, part]
    for prior in priors:
        known, _ = prior.rows(rests.sensor.coefficients)
        known = known * rests.sensor.unit_scale
        information += known.T @ known
    return information


def _attitude_count(rests: int, coefficients: int) -> int:
    """Return how many attitudes to name: the number of missing rests, and 4 at least."""
    return max(coefficients + 3 - rests, 4)


def _coverage_gaps(rests: Rests, ups: Array) -> str:
    """Say in words what the rests and the turns between them do not cover."""
    count, a = len(ups), len(rests.force.coefficients)
    parts = [f"{count} rests"]
    if count < a:
        parts = [f"{count} rests for {a} coefficients of the accelerometers"]
    bare = [
        sign + name
        for k, name in enumerate("xyz")
        for sign, along in (("+", ups[:, k]), ("−", -ups[:, k]))
        if not (along > _COVERED_COSINE).any()
    ]
    if bare:
        parts.append(f"none has {', '.join(bare)} up within 45°")
    _, size, axes = np.linalg.svd(ups)
    if count > 3 and size[-1] < np.sin(np.radians(10)) * size[0]:
        off = np.degrees(np.arcsin(min(size[-1] / count**0.5, 1.0)))
        normal = ", ".join(f"{part:+.2f}" for part in axes[-1])
        parts.append(f"all are within {off:.1f}° rms of the plane across ({normal})")
    return ", ".join(parts)


def attitudes_in_words(ups: Sequence[Array]) -> str:
    """Return attitudes as an instruction."""
    holds = [Hold("", (float(x), float(y), float(z)), 0.0) for x, y, z in ups]
    return f"hold {'; '.join(hold.describe() for hold in holds)}"

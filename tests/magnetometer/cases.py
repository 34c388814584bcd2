"""Simulated recordings as the records of inercal, and statistics of the fits."""
# Arrays and records without annotations, because a plain script is easier to compare with formulas.
# pyright: reportUnknownParameterType=false, reportArgumentType=false
# pyright: reportPossiblyUnboundVariable=false

import numpy as np

from inercal.basics.units import Measured
from inercal.methods.magnetic_field.fitting import fit_field
from inercal.methods.magnetic_field.records import (
    Directions,
    FieldConditions,
    FieldNodes,
    LinearModel,
    Links,
)

NAMES = (*(f"m{i}.{what}" for i in "xyz" for what in ("bias", "scale", "delta_o", "delta_p")),)


def linear_model(axes=None):
    """Return bias, scale and two misalignments of each of three stated axes."""
    axes = np.eye(3) if axes is None else axes
    directions = np.zeros((12, 3, 4))
    for i in range(3):
        directions[4 * i, i, 3] = 1.0
        directions[4 * i + 1, i, :3] = axes[i]
        directions[4 * i + 2, i, :3] = axes[(i + 1) % 3]
        directions[4 * i + 3, i, :3] = -axes[(i + 2) % 3]
    return LinearModel(NAMES, np.column_stack([axes, np.zeros(3)]), directions)


def true_values(model, own, dip=True, per_field=False):
    """Return the coefficients of the device, its dip and strength.

    With `per_field`, D is divided by its mean scale relative to the stated axes.
    """
    mean = np.mean(np.diag(own.d @ np.linalg.inv(model.nominal[:, :3]))) if per_field else 1.0
    wanted = np.column_stack([own.d / mean, own.o]) - model.nominal
    c = np.linalg.solve(model.directions.reshape(12, 12).T, wanted.ravel())
    return np.concatenate([c, [own.dip] * dip, [own.strength * mean]])


def records(data):
    """Return nodes, directions, links and the covariance of the known coefficients."""
    n, d, q = len(data.reading), len(data.node), len(data.known)
    nodes = FieldNodes(
        tuple(f"rest {k + 1}" for k in range(n)),
        data.reading,
        data.sigma_m[:, None, None] ** 2 * np.eye(3),
        np.arange(n) * 10.0,
        np.zeros(n),
    )
    covariance = np.tile(data.up_sd**2 * np.eye(3), (d, 1, 1))
    directions = Directions(data.node, data.up, covariance, data.up_by_known)
    count = len(data.before)
    links = Links.none(q)
    if count:
        links = Links(
            data.before,
            data.turn,
            np.tile(data.turn_sd**2 * np.eye(3), (count, 1, 1)),
            data.turn_by_known,
            np.full(count, data.about_up),
        )
    return nodes, directions, links, data.known


def fit(data, model=None, strength_sd=0.0, **conditions):
    """Fit with a known strength (unless `strength_sd` is None), in the northern hemisphere."""
    nodes, directions, links, known = records(data)
    strength = None if strength_sd is None else Measured(data.device.strength, strength_sd)
    stated = FieldConditions(strength, **{"hemisphere": "north", **conditions})
    model = linear_model() if model is None else model
    return fit_field(nodes, model, directions, links, stated, known)


def normalised_error(found, own, model=None):
    """Return the squared error, normalised by its covariance and by the number of unknowns.

    Without a stated strength, the strength replaces one of the scales.
    """
    left_out = "mx.scale" if found.per_field else "strength"
    kept = [k for k, name in enumerate(found.names) if name != left_out]
    model = linear_model() if model is None else model
    true = true_values(model, own, "dip" in found.names, found.per_field)
    covariance = found.covariance[np.ix_(kept, kept)]
    size = np.sqrt(np.diagonal(covariance))
    scaled = (found.value - true)[kept] / size
    return scaled @ np.linalg.solve(covariance / np.outer(size, size), scaled) / len(kept)


def band(dof, count):
    """Return four standard errors of the mean of `count` values of χ²/dof."""
    return 4 * np.sqrt(2 / (dof * count))

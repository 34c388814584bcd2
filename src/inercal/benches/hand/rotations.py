"""Rotations of vectors in the frame of a sensor that is turned by hand."""

import numpy as np

from inercal.basics.arrays import Array


def shortest_rotation(start: Array, end: Array) -> tuple[Array, Array]:
    """Return the rotation from start to end: its axis, (trials, 3), and angle, (trials,)."""
    axis = np.cross(start, end)
    size = np.linalg.norm(axis, axis=-1, keepdims=True)
    aside = np.cross(start, np.eye(3)[np.argmin(np.abs(start[0]))])
    axis = np.where(size > 1e-12, axis, aside)  # to the opposite face about any level axis
    axis = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    return axis, np.arctan2((np.cross(start, end) * axis).sum(-1), (start * end).sum(-1))


def rotate_vectors(axis: Array, angles: Array, vector: Array) -> Array:
    """Rotate a vector about an axis by angles, (trials, n), and return (trials, n, 3)."""
    cos, sin = np.cos(angles)[..., None], np.sin(angles)[..., None]
    along = axis * (axis * vector).sum(-1, keepdims=True)
    return along[:, None] + (vector - along)[:, None] * cos + np.cross(axis, vector)[:, None] * sin

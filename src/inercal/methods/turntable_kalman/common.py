"""What both filters hand to their kernels, and read from them."""

import numpy as np
from numpy.typing import NDArray

from inercal.benches.turntable import Turntable
from inercal.estimate import Course
from inercal.methods.turntable.model import CORRELATION, Triad, earth
from inercal.methods.turntable_kalman._common import Model

Array = NDArray[np.float64]


def known(part: Triad, bench: Turntable) -> Model:
    """Return what a kernel knows of a triad, and of where it is."""
    return Model(part.terms, part.white, part.drift, CORRELATION, earth(bench), bench.gravity.value)


def course(name: str, names: tuple[str, ...], time: Array, history: Array, q: int) -> Course:
    """Return the course of what a kernel wrote, (e, q + 1 + 2 n), of the last states alone."""
    n, k = (history.shape[1] - q - 1) // 2, len(names)
    value, variance = history[:, q + 1 : q + 1 + n], history[:, q + 1 + n :]
    return Course(
        name, names, time, value[:, n - k :], np.sqrt(variance[:, n - k :]),
        history[:, :q], history[:, q],
    )  # fmt: skip

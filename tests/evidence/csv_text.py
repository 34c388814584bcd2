"""Tables of numbers as text, as a laboratory would write them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def csv(names: Sequence[str], *columns: Sequence[str] | NDArray[np.float64]) -> str:
    """Return lines of values at full precision, with a header; matrices give several columns."""
    texts: list[list[str]] = []
    for column in columns:
        if isinstance(column, np.ndarray):
            texts += [[repr(float(x)) for x in one] for one in np.atleast_2d(column.T)]
        else:
            texts.append(list(column))
    lines = [",".join(names), *(",".join(row) for row in zip(*texts, strict=True))]
    return "\n".join(lines) + "\n"

"""The type of the arrays: 64-bit floats."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

"""A robust loss, which limits the influence of large residuals.

The cost of a whitened residual u is ρ(u), equal to u² where u is small; ψ = ρ′/2 is its influence
and w = ψ/u the weight of the equivalent weighted least squares. The default threshold keeps 95 % of
the efficiency of least squares where the noise is Gaussian (Holland and Welsch 1977, Communications
in Statistics A6, 813–827, table 1).
"""

from dataclasses import dataclass

import numpy as np

from inercal.arrays import Array


@dataclass(frozen=True)
class Cauchy:
    """Logarithmic beyond the threshold: a far outlier has hardly any influence."""

    threshold: float = 2.385

    def cost(self, u: Array) -> Array:
        """Return ρ(u)."""
        return self.threshold**2 * np.log1p((u / self.threshold) ** 2)

    def weight(self, u: Array) -> Array:
        """Return w(u) = ψ(u)/u."""
        return 1 / (1 + (u / self.threshold) ** 2)

    def slope(self, u: Array) -> Array:
        """Return ψ′(u)."""
        z = (u / self.threshold) ** 2
        return (1 - z) / (1 + z) ** 2

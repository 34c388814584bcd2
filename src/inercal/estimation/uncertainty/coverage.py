"""The coverage factor of every expanded uncertainty that is stated."""

COVERAGE = 2.0
"""k of U = k u; about 95 % for the usual degrees of freedom (GUM 6.3)."""
COVERAGE_PROBABILITY = 0.9545
"""Of an interval of ± 2u of a normal distribution; intervals of other ones have it, too."""

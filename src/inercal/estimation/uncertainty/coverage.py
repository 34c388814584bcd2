"""The coverage factor used for all stated expanded uncertainties."""

COVERAGE = 2.0
"""The coverage factor k in U = k u; it gives about 95 % for usual degrees of freedom (GUM 6.3)."""
COVERAGE_PROBABILITY = 0.9545
"""Coverage of ± 2u for a normal distribution; it is also used for other distributions."""

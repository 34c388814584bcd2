"""The provenance key that marks a calibration of simulated data."""

SIMULATED = "simulated"
"""Key in `Calibration.provenance`; its text says how we know that the data are simulated."""

"""Whether a calibration is of simulated data: its provenance says by what that is known."""

SIMULATED = "simulated"
"""The key of `Calibration.provenance`."""

"""Fleets: the sensors of a production line calibrated in batches, and what they have in common."""

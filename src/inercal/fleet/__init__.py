"""Fleets: batch calibration of the sensors of a production line, and statistics over them."""

"""Calibrate all sensors of a production line (a fleet), and compute statistics over them."""

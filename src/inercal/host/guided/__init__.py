"""Guided measurement: an operator fills in the worksheet of a bench that no host can drive."""

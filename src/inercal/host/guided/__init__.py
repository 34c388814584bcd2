"""Guided measurement: an operator fills the worksheet of a bench that no host drives."""

"""Sensor models, frames, the Earth, motion and test plans."""

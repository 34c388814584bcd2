"""Describe a precision centrifuge as a bench."""

from inercal.benches.centrifuge.bench import Centrifuge

__all__ = ["Centrifuge"]

"""The bench of a precision centrifuge."""

from inercal.benches.centrifuge.bench import Centrifuge

__all__ = ["Centrifuge"]

"""The bench of a turntable of one to three axes."""

from inercal.benches.turntable.bench import Turntable

__all__ = ["Turntable"]

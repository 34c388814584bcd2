"""From a recording on a turntable to the track that its methods follow."""

from inercal.benches.turntable.reading.run import observe

__all__ = ["observe"]

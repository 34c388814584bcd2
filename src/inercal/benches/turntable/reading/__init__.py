"""From a recording on a turntable to the track that its methods follow."""

from inercal.benches.turntable.reading.track_observation import observe

__all__ = ["observe"]

"""From a recording on a turntable to the track that its methods follow."""

from inercal.pipeline.turntable.run import gather

__all__ = ["gather"]

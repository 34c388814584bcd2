"""From a recording on a turntable to the track that its methods follow."""

from inercal.pipeline.turntable.found import far_from_stated, of_source
from inercal.pipeline.turntable.run import gather

__all__ = ["far_from_stated", "gather", "of_source"]

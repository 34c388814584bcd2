"""From a recording on a turntable to the track that its methods follow."""

"""Read the track that the methods follow from a recording on a turntable."""

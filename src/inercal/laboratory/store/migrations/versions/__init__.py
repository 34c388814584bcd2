"""The revisions, one in each module."""

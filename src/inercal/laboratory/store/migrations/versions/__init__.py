"""The revisions of the tables, one in each module."""

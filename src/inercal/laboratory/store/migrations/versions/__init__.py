"""The revisions of the tables; each module contains one revision."""

"""The command line; each module implements one verb."""

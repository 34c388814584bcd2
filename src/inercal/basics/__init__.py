"""Foundations used by all packages: errors, units, names, files, settings and processes."""

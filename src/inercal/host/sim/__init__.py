"""Simulators that answer like real tables and IMUs; they share no code with the drivers."""

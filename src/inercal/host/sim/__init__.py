"""Simulators of tables that answer as the real ones do; nothing here is shared with the drivers."""

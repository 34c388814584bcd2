"""Drivers of tables, one a controller, alike to whoever moves them: see `table`."""

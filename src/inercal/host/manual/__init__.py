"""Manual operation of a table: commands, dead-man control of jogs, and the main loop."""

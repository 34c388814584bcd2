"""Manual operation of a table: commands, dead-man control of a jog, and the main loop."""

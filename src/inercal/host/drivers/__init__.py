"""Drivers of tables, one for each controller, with a common interface: `rotary_table`."""

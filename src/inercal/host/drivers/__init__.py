"""Drivers of tables: one for each controller, all with the interface in `rotary_table`."""

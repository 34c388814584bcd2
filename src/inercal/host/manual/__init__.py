"""A table operated by hand: commands, the dead-man of a jog, the loop that drives the table."""

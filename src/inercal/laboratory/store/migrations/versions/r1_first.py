"""The tables of the first release; nothing leads to them, because a new register is stamped."""

revision = "1"
down_revision = None

"""The revisions of the register's tables; Alembic applies them when a register is opened."""

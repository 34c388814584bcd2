"""The revisions of a register's tables, oldest first; Alembic runs them when one is opened."""

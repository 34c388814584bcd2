"""The revisions of a register's tables, the first first; Alembic runs them when one is opened."""

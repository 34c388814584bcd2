"""Revise the tables of a register; Alembic applies the revisions when a register is opened."""

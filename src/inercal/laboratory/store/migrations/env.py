"""Runs all migrations for Alembic in the transaction of the connection it is given."""

from alembic import context

from inercal.laboratory.store.register_tables import metadata


def migrate() -> None:
    """Run the pending revisions."""
    context.configure(
        connection=context.config.attributes["connection"],
        target_metadata=metadata,
        version_table=context.config.attributes["version_table"],
        transactional_ddl=True,  # so it is on SQLite too: `connection` begins transactions itself
    )
    context.run_migrations()


if __name__ == "env_py":  # the name under which Alembic runs it; others only look at it
    migrate()

"""Script in which Alembic runs all migrations, in the transaction of a given connection."""

from alembic import context

from inercal.laboratory.store.register_tables import metadata


def migrate() -> None:
    """Run the pending revisions."""
    context.configure(
        connection=context.config.attributes["connection"],
        target_metadata=metadata,
        version_table=context.config.attributes["version_table"],
        transactional_ddl=True,  # also on SQLite, because `connection` begins transactions itself
    )
    context.run_migrations()


if __name__ == "env_py":  # Alembic runs this file under this name; other imports do nothing
    migrate()

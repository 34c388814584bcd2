"""The grade of each calibration's verdict; of those that are there it is unknown."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Add its column."""
    column = sa.Column("grade", sa.String, nullable=False, server_default="")
    op.add_column("calibration", column)

"""Noise analyses of sensors at rest."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"


def upgrade() -> None:
    """Make the tables of analyses and of their coefficients."""
    texts = ("measured", "measured_from", "source", "recording_sha256")
    op.create_table(
        "noise_analysis",
        sa.Column("id", sa.Integer, nullable=False),
        sa.Column("sensor_id", sa.Integer, nullable=False),
        *(sa.Column(name, sa.String, nullable=False) for name in texts),
        sa.Column("duration", sa.Double, nullable=False),
        sa.Column("content", sa.Text, nullable=False),
        *(
            sa.Column(name, sa.String, nullable=False)
            for name in ("sha256", "entered_by", "entered_at")
        ),
        sa.PrimaryKeyConstraint("id", name="pk_noise_analysis"),
        sa.ForeignKeyConstraint(["sensor_id"], ["sensor.id"], name="fk_noise_analysis_sensor_id"),
    )
    op.create_index("ix_noise_analysis_sensor_id", "noise_analysis", ["sensor_id"])
    op.create_table(
        "noise_coefficient",
        sa.Column("analysis_id", sa.Integer, nullable=False),
        sa.Column("channel", sa.String, nullable=False),
        sa.Column("symbol", sa.String, nullable=False),
        sa.Column("place", sa.Integer, nullable=False),
        sa.Column("value", sa.Double, nullable=False),
        sa.Column("u", sa.Double),
        sa.Column("low", sa.Double, nullable=False),
        sa.Column("high", sa.Double, nullable=False),
        sa.Column("unit", sa.String, nullable=False),
        sa.PrimaryKeyConstraint("analysis_id", "channel", "symbol", name="pk_noise_coefficient"),
        sa.ForeignKeyConstraint(
            ["analysis_id"], ["noise_analysis.id"], name="fk_noise_coefficient_analysis_id"
        ),
    )

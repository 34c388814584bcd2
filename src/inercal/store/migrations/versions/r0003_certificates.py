"""Certificates: issued once, and neither changed nor deleted afterwards."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"

_REASON = "certificates are immutable"


def upgrade() -> None:
    """Make the table, and what keeps its rows as they are."""
    op.create_table(
        "certificate",
        sa.Column("id", sa.Integer, nullable=False),
        sa.Column("number", sa.String, nullable=False),
        sa.Column("series", sa.String, nullable=False),
        sa.Column("year", sa.Integer, nullable=False),
        sa.Column("sequence", sa.Integer, nullable=False),
        sa.Column("calibration_id", sa.Integer, nullable=False),
        *(
            sa.Column(name, sa.String, nullable=False)
            for name in ("issued", "change", "previous", "pdf_sha256", "dcc_sha256")
        ),
        sa.Column("pdf", sa.LargeBinary, nullable=False),
        sa.Column("dcc", sa.LargeBinary, nullable=False),
        sa.Column("entered_by", sa.String, nullable=False),
        sa.Column("entered_at", sa.String, nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_certificate"),
        sa.UniqueConstraint("number", name="uq_certificate_number"),
        sa.UniqueConstraint(
            "series", "year", "sequence", name="uq_certificate_series_year_sequence"
        ),
        sa.ForeignKeyConstraint(
            ["calibration_id"], ["calibration.id"], name="fk_certificate_calibration_id"
        ),
    )
    op.create_index("ix_certificate_calibration_id", "certificate", ["calibration_id"])
    if op.get_bind().dialect.name == "postgresql":
        op.execute(
            "CREATE FUNCTION inercal_keep_certificate() RETURNS trigger LANGUAGE plpgsql AS "
            f"$$ BEGIN RAISE EXCEPTION '{_REASON}'; END $$"
        )
        op.execute(
            "CREATE TRIGGER keep_certificate BEFORE UPDATE OR DELETE OR TRUNCATE ON certificate "
            "FOR EACH STATEMENT EXECUTE FUNCTION inercal_keep_certificate()"
        )
        return
    for event in ("UPDATE", "DELETE"):
        op.execute(
            f"CREATE TRIGGER keep_certificate_{event.lower()} BEFORE {event} ON certificate "
            f"BEGIN SELECT RAISE(ABORT, '{_REASON}'); END"
        )
    # INSERT OR REPLACE deletes rows in its way without the trigger of DELETE.
    op.execute(
        "CREATE TRIGGER keep_certificate_replace BEFORE INSERT ON certificate WHEN EXISTS "
        "(SELECT 1 FROM certificate WHERE id = NEW.id OR number = NEW.number OR (series, year, "
        "sequence) = (NEW.series, NEW.year, NEW.sequence)) "
        f"BEGIN SELECT RAISE(ABORT, '{_REASON}'); END"
    )

"""Create the tables of sensors, benches, runs, calibrations, certificates and noise analyses.

Triggers ensure that an issued certificate cannot be changed or deleted.
"""

import sqlalchemy as sa
from alembic import op

revision = "1"
down_revision = None

_REASON = "certificates are immutable"


def upgrade() -> None:
    """Create the tables."""
    op.create_table(
        "sensor",
        sa.Column("id", sa.Integer, nullable=False),
        sa.Column("name", sa.String, nullable=False),
        sa.Column("axes", sa.Text, nullable=False),
        *_entered(),
        sa.PrimaryKeyConstraint("id", name="pk_sensor"),
        sa.UniqueConstraint("name", name="uq_sensor_name"),
    )
    op.create_table(
        "bench",
        sa.Column("id", sa.Integer, nullable=False),
        *_texts("kind", "name"),
        *_entered(),
        sa.PrimaryKeyConstraint("id", name="pk_bench"),
        sa.UniqueConstraint("kind", "name", name="uq_bench_kind_name"),
    )
    op.create_table(
        "run",
        sa.Column("id", sa.Integer, nullable=False),
        *_texts("key"),
        *_numbers("sensor_id", "bench_id"),
        *_texts("begun", "state", "table_address", "imu_address", "folder"),
        *_entered(),
        sa.PrimaryKeyConstraint("id", name="pk_run"),
        sa.UniqueConstraint("key", name="uq_run_key"),
        sa.ForeignKeyConstraint(["sensor_id"], ["sensor.id"], name="fk_run_sensor_id"),
        sa.ForeignKeyConstraint(["bench_id"], ["bench.id"], name="fk_run_bench_id"),
    )
    op.create_index("ix_run_sensor_id", "run", ["sensor_id"])
    op.create_table(
        "file",
        sa.Column("run_id", sa.Integer, nullable=False),
        sa.Column("name", sa.String, nullable=False),
        sa.Column("size", sa.BigInteger, nullable=False),
        sa.Column("sha256", sa.String, nullable=False),
        *_entered(),
        sa.PrimaryKeyConstraint("run_id", "name", name="pk_file"),
        sa.ForeignKeyConstraint(["run_id"], ["run.id"], name="fk_file_run_id"),
    )
    op.create_index("ix_file_sha256", "file", ["sha256"])
    op.create_table(
        "calibration",
        sa.Column("id", sa.Integer, nullable=False),
        sa.Column("sensor_id", sa.Integer, nullable=False),
        sa.Column("bench_id", sa.Integer),
        sa.Column("run_id", sa.Integer),
        *_texts("measured", "measured_from", "method", "estimator", "recording_sha256"),
        sa.Column("grade", sa.String, nullable=False, server_default=""),
        sa.Column("content", sa.Text, nullable=False),
        sa.Column("sha256", sa.String, nullable=False),
        *_entered(),
        sa.PrimaryKeyConstraint("id", name="pk_calibration"),
        sa.UniqueConstraint("sha256", name="uq_calibration_sha256"),
        sa.ForeignKeyConstraint(["sensor_id"], ["sensor.id"], name="fk_calibration_sensor_id"),
        sa.ForeignKeyConstraint(["bench_id"], ["bench.id"], name="fk_calibration_bench_id"),
        sa.ForeignKeyConstraint(["run_id"], ["run.id"], name="fk_calibration_run_id"),
    )
    for name in ("sensor_id", "run_id", "recording_sha256"):
        op.create_index(f"ix_calibration_{name}", "calibration", [name])
    op.create_table(
        "coefficient",
        sa.Column("calibration_id", sa.Integer, nullable=False),
        sa.Column("name", sa.String, nullable=False),
        sa.Column("place", sa.Integer, nullable=False),
        sa.Column("value", sa.Double, nullable=False),
        sa.Column("std", sa.Double, nullable=False),
        sa.Column("unit", sa.String, nullable=False),
        sa.PrimaryKeyConstraint("calibration_id", "name", name="pk_coefficient"),
        sa.ForeignKeyConstraint(
            ["calibration_id"], ["calibration.id"], name="fk_coefficient_calibration_id"
        ),
    )
    _create_certificates()
    _create_noise_analyses()


def _create_certificates() -> None:
    """Create the table of certificates, and triggers that protect its rows from changes."""
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
    # INSERT OR REPLACE deletes conflicting rows without the DELETE trigger.
    op.execute(
        "CREATE TRIGGER keep_certificate_replace BEFORE INSERT ON certificate WHEN EXISTS "
        "(SELECT 1 FROM certificate WHERE id = NEW.id OR number = NEW.number OR (series, year, "
        "sequence) = (NEW.series, NEW.year, NEW.sequence)) "
        f"BEGIN SELECT RAISE(ABORT, '{_REASON}'); END"
    )


def _create_noise_analyses() -> None:
    """Create the tables of noise analyses and their coefficients."""
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


def _texts(*names: str) -> "list[sa.Column[str]]":
    return [sa.Column(name, sa.String, nullable=False) for name in names]


def _numbers(*names: str) -> "list[sa.Column[int]]":
    return [sa.Column(name, sa.Integer, nullable=False) for name in names]


def _entered() -> "list[sa.Column[str]]":
    return _texts("entered_by", "entered_at")

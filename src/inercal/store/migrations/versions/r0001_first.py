"""The first tables: sensors, benches, runs with their files, calibrations with coefficients."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None


def upgrade() -> None:
    """Make them."""
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


def _texts(*names: str) -> "list[sa.Column[str]]":
    return [sa.Column(name, sa.String, nullable=False) for name in names]


def _numbers(*names: str) -> "list[sa.Column[int]]":
    return [sa.Column(name, sa.Integer, nullable=False) for name in names]


def _entered() -> "list[sa.Column[str]]":
    return _texts("entered_by", "entered_at")

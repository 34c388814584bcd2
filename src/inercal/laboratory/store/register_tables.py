"""The tables of a register; changing them requires a revision in `migrations/versions`.

Times are stored as text in ISO 8601, UTC, to the millisecond, so they sort chronologically.
"""

from sqlalchemy import (
    BigInteger,
    Column,
    Double,
    ForeignKey,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    Text,
    UniqueConstraint,
)

metadata = MetaData(
    naming_convention={
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s",
        "pk": "pk_%(table_name)s",
    }
)


def _text_columns(*names: str) -> list[Column[str]]:
    """Return text columns in which every row must have a value."""
    return [Column(name, String, nullable=False) for name in names]


def _entry_columns() -> list[Column[str]]:
    """Return the columns for the author and time of an entry."""
    return _text_columns("entered_by", "entered_at")


sensor = Table(
    "sensor",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("name", String, nullable=False, unique=True),
    Column("axes", Text, nullable=False),  # JSON list of {name, measures}
    *_entry_columns(),
)
bench = Table(
    "bench",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("kind", String, nullable=False),
    Column("name", String, nullable=False),  # empty if the run file states no name
    *_entry_columns(),
    UniqueConstraint("kind", "name"),
)
run = Table(
    "run",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("key", String, nullable=False, unique=True),
    Column("sensor_id", Integer, ForeignKey("sensor.id"), nullable=False, index=True),
    Column("bench_id", Integer, ForeignKey("bench.id"), nullable=False),
    *_text_columns("begun", "state", "table_address", "imu_address", "folder"),
    *_entry_columns(),
)
file = Table(
    "file",
    metadata,
    Column("run_id", Integer, ForeignKey("run.id"), primary_key=True),
    Column("name", String, primary_key=True),
    Column("size", BigInteger, nullable=False),
    Column("sha256", String, nullable=False, index=True),
    *_entry_columns(),
)
calibration = Table(
    "calibration",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("sensor_id", Integer, ForeignKey("sensor.id"), nullable=False, index=True),
    Column(
        "bench_id", Integer, ForeignKey("bench.id")
    ),  # null if this version does not know the method
    Column("run_id", Integer, ForeignKey("run.id"), index=True),
    Column("measured", String, nullable=False),
    Column("measured_from", String, nullable=False),  # "stated", "run" or "created"
    *_text_columns("method", "estimator"),
    Column("grade", String, nullable=False, server_default=""),  # empty if unknown
    Column("recording_sha256", String, nullable=False, index=True),  # empty if not stated
    Column("content", Text, nullable=False),  # the whole file as JSON
    Column("sha256", String, nullable=False, unique=True),
    *_entry_columns(),
)
coefficient = Table(
    "coefficient",
    metadata,
    Column("calibration_id", Integer, ForeignKey("calibration.id"), primary_key=True),
    Column("name", String, primary_key=True),
    Column("place", Integer, nullable=False),  # index in the calibration, from 0
    Column("value", Double, nullable=False),
    Column("std", Double, nullable=False),
    Column("unit", String, nullable=False),  # SI
)
certificate = Table(  # database triggers prevent changes and deletion of rows
    "certificate",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("number", String, nullable=False, unique=True),
    Column("series", String, nullable=False),  # the pattern of the number
    Column("year", Integer, nullable=False),
    Column("sequence", Integer, nullable=False),
    Column("calibration_id", Integer, ForeignKey("calibration.id"), nullable=False, index=True),
    *_text_columns("issued"),  # ISO date
    *_text_columns("change"),  # "amended" or "substituted"; empty if it changes none
    *_text_columns("previous"),  # number of the changed certificate
    *_text_columns("pdf_sha256", "dcc_sha256"),
    Column("pdf", LargeBinary, nullable=False),
    Column("dcc", LargeBinary, nullable=False),  # XML
    *_entry_columns(),
    UniqueConstraint("series", "year", "sequence"),
)

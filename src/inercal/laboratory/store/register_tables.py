"""Define the tables of a register; a change needs a revision in `migrations/versions`.

A new register gets these tables at once, and only an older register is revised. Triggers ensure
that an issued certificate cannot be changed or deleted.

Times are stored as text in ISO 8601, UTC, to the millisecond, so they sort chronologically.
"""

import sqlalchemy as sa
from sqlalchemy import event

metadata = sa.MetaData(
    naming_convention={
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s",
        "pk": "pk_%(table_name)s",
    }
)


def _text_columns(*names: str) -> list[sa.Column[str]]:
    """Return text columns in which every row must have a value."""
    return [sa.Column(name, sa.String, nullable=False) for name in names]


def _entry_columns() -> list[sa.Column[str]]:
    """Return the columns for the author and time of an entry."""
    return _text_columns("entered_by", "entered_at")


sensor = sa.Table(
    "sensor",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("name", sa.String, nullable=False, unique=True),
    sa.Column("axes", sa.Text, nullable=False),  # JSON list of {name, measures}
    *_entry_columns(),
)
bench = sa.Table(
    "bench",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    *_text_columns("kind", "name"),  # the name is empty if the run file states no name
    *_entry_columns(),
    sa.UniqueConstraint("kind", "name"),
)
run = sa.Table(
    "run",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("key", sa.String, nullable=False, unique=True),
    sa.Column("sensor_id", sa.Integer, sa.ForeignKey("sensor.id"), nullable=False, index=True),
    sa.Column("bench_id", sa.Integer, sa.ForeignKey("bench.id"), nullable=False),
    *_text_columns("begun", "state", "table_address", "imu_address", "folder"),
    *_entry_columns(),
)
file = sa.Table(
    "file",
    metadata,
    sa.Column("run_id", sa.Integer, sa.ForeignKey("run.id"), primary_key=True),
    sa.Column("name", sa.String, primary_key=True),
    sa.Column("size", sa.BigInteger, nullable=False),
    sa.Column("sha256", sa.String, nullable=False, index=True),
    *_entry_columns(),
)
calibration = sa.Table(
    "calibration",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("sensor_id", sa.Integer, sa.ForeignKey("sensor.id"), nullable=False, index=True),
    # Null if this version does not know the method.
    sa.Column("bench_id", sa.Integer, sa.ForeignKey("bench.id")),
    sa.Column("run_id", sa.Integer, sa.ForeignKey("run.id"), index=True),
    # measured_from is "stated", "run" or "created".
    *_text_columns("measured", "measured_from", "method", "estimator"),
    sa.Column("grade", sa.String, nullable=False, server_default=""),  # empty if unknown
    sa.Column("recording_sha256", sa.String, nullable=False, index=True),  # empty if not stated
    sa.Column("content", sa.Text, nullable=False),  # the whole file as JSON
    sa.Column("sha256", sa.String, nullable=False, unique=True),
    *_entry_columns(),
)
coefficient = sa.Table(
    "coefficient",
    metadata,
    sa.Column("calibration_id", sa.Integer, sa.ForeignKey("calibration.id"), primary_key=True),
    sa.Column("name", sa.String, primary_key=True),
    sa.Column("place", sa.Integer, nullable=False),  # index in the calibration, from 0
    sa.Column("value", sa.Double, nullable=False),
    sa.Column("std", sa.Double, nullable=False),
    sa.Column("unit", sa.String, nullable=False),  # SI
)
certificate = sa.Table(
    "certificate",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("number", sa.String, nullable=False, unique=True),
    sa.Column("series", sa.String, nullable=False),  # the pattern of the number
    sa.Column("year", sa.Integer, nullable=False),
    sa.Column("sequence", sa.Integer, nullable=False),
    sa.Column(
        "calibration_id", sa.Integer, sa.ForeignKey("calibration.id"), nullable=False, index=True
    ),
    # issued is an ISO date. change is "amended" or "substituted", and previous is the number of the
    # changed certificate; both are empty if it changes none.
    *_text_columns("issued", "change", "previous", "pdf_sha256", "dcc_sha256"),
    sa.Column("pdf", sa.LargeBinary, nullable=False),
    sa.Column("dcc", sa.LargeBinary, nullable=False),  # XML
    *_entry_columns(),
    sa.UniqueConstraint("series", "year", "sequence"),
)
noise_analysis = sa.Table(
    "noise_analysis",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("sensor_id", sa.Integer, sa.ForeignKey("sensor.id"), nullable=False, index=True),
    # measured_from is "stated" or "entered", and source is the name of the recording file.
    *_text_columns("measured", "measured_from", "source", "recording_sha256"),
    sa.Column("duration", sa.Double, nullable=False),  # s
    sa.Column("content", sa.Text, nullable=False),  # the whole analysis as JSON
    sa.Column("sha256", sa.String, nullable=False),  # SHA-256 of the content
    *_entry_columns(),
)
noise_coefficient = sa.Table(
    "noise_coefficient",
    metadata,
    sa.Column("analysis_id", sa.Integer, sa.ForeignKey("noise_analysis.id"), primary_key=True),
    sa.Column("channel", sa.String, primary_key=True),
    sa.Column("symbol", sa.String, primary_key=True),
    sa.Column("place", sa.Integer, nullable=False),  # index in the analysis, from 0
    sa.Column("value", sa.Double, nullable=False),  # SI; 0 if only an upper limit is known
    sa.Column("u", sa.Double),  # SI; null if only an upper limit is known
    sa.Column("low", sa.Double, nullable=False),
    sa.Column("high", sa.Double, nullable=False),
    sa.Column("unit", sa.String, nullable=False),  # unit for printing
)


_REASON = "certificates are immutable"
_TRIGGERS = {
    "postgresql": (
        "CREATE FUNCTION inercal_keep_certificate() RETURNS trigger LANGUAGE plpgsql AS "
        f"$$ BEGIN RAISE EXCEPTION '{_REASON}'; END $$",
        "CREATE TRIGGER keep_certificate BEFORE UPDATE OR DELETE OR TRUNCATE ON certificate "
        "FOR EACH STATEMENT EXECUTE FUNCTION inercal_keep_certificate()",
    ),
    "sqlite": (
        *(
            f"CREATE TRIGGER keep_certificate_{change.lower()} BEFORE {change} ON certificate "
            f"BEGIN SELECT RAISE(ABORT, '{_REASON}'); END"
            for change in ("UPDATE", "DELETE")
        ),
        # INSERT OR REPLACE deletes conflicting rows without the DELETE trigger.
        "CREATE TRIGGER keep_certificate_replace BEFORE INSERT ON certificate WHEN EXISTS "
        "(SELECT 1 FROM certificate WHERE id = NEW.id OR number = NEW.number OR (series, year, "
        "sequence) = (NEW.series, NEW.year, NEW.sequence)) "
        f"BEGIN SELECT RAISE(ABORT, '{_REASON}'); END",
    ),
}
for _dialect, _statements in _TRIGGERS.items():
    for _statement in _statements:
        trigger = sa.DDL(_statement).execute_if(dialect=_dialect)
        event.listen(certificate, "after_create", trigger)

"""The tables of noise analyses in a register. A change goes with a revision."""

from sqlalchemy import Column, Double, ForeignKey, Integer, String, Table, Text

from inercal.store.register_tables import metadata

noise_analysis = Table(
    "noise_analysis",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("sensor_id", Integer, ForeignKey("sensor.id"), nullable=False, index=True),
    Column("measured", String, nullable=False),
    Column("measured_from", String, nullable=False),  # "stated" or "entered"
    Column("source", String, nullable=False),  # the recording's file
    Column("recording_sha256", String, nullable=False),
    Column("duration", Double, nullable=False),  # s
    Column("content", Text, nullable=False),  # the whole analysis, JSON
    Column("sha256", String, nullable=False),  # of the content
    Column("entered_by", String, nullable=False),
    Column("entered_at", String, nullable=False),
)
noise_coefficient = Table(
    "noise_coefficient",
    metadata,
    Column("analysis_id", Integer, ForeignKey("noise_analysis.id"), primary_key=True),
    Column("channel", String, primary_key=True),
    Column("symbol", String, primary_key=True),
    Column("place", Integer, nullable=False),  # in the analysis's order, from 0
    Column("value", Double, nullable=False),  # SI; 0 where only an upper limit is known
    Column("u", Double),  # SI; null where only an upper limit is known
    Column("low", Double, nullable=False),
    Column("high", Double, nullable=False),
    Column("unit", String, nullable=False),  # in which it is printed
)

"""The register: what a laboratory keeps of its sensors, in SQLite or on a PostgreSQL server.

Sensors, benches, runs with the hashes of their raw data, and calibrations whole, each with who
entered it and when. Nothing in it is the only copy: it is filled from the folders of runs and the
files of calibrations, as often as one likes.
"""

from inercal.errors import require_extra

_PACKAGES = ("sqlalchemy", "alembic", "psycopg")
with require_extra("store", "the register needs SQLAlchemy and Alembic", _PACKAGES):
    from inercal.store.entries import CalibrationEntry, FileEntry, RunEntry, RunFacts, SensorEntry
    from inercal.store.history import SensorHistory
    from inercal.store.register import Register

__all__ = [
    "CalibrationEntry",
    "FileEntry",
    "Register",
    "RunEntry",
    "RunFacts",
    "SensorEntry",
    "SensorHistory",
]

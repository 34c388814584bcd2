"""The register: what a laboratory keeps of its sensors, in SQLite or on a PostgreSQL server.

Sensors, benches, runs with the hashes of their raw data, and calibrations whole, each with who
entered it and when. Nothing in it is the only copy: it is filled from the folders of runs and the
files of calibrations, as often as one likes.
"""

from inercal.errors import InputError

try:
    from inercal.store.entries import CalibrationEntry, FileEntry, RunEntry, RunFacts, SensorEntry
    from inercal.store.history import History
    from inercal.store.register import Register
except ImportError as error:
    # A broken module of this package is no missing extra.
    if (error.name or "").partition(".")[0] not in ("sqlalchemy", "alembic", "psycopg"):
        raise
    raise InputError(
        "the register needs SQLAlchemy and Alembic: pip install 'inercal[store]'"
    ) from error

__all__ = [
    "CalibrationEntry",
    "FileEntry",
    "History",
    "Register",
    "RunEntry",
    "RunFacts",
    "SensorEntry",
]

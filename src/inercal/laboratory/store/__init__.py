"""Keep the register of a laboratory's sensors, in SQLite or on a PostgreSQL server.

The register stores sensors, benches, runs with the hashes of their raw data, and complete
calibration files, each with its author and time of entry. It is never the only copy of these data:
folders of runs and calibration files can be entered again at any time. For certificates, however,
the register is the official record. `backup` makes a copy of the register.
"""

from inercal.basics.errors import require_extra

_PACKAGES = ("sqlalchemy", "alembic", "psycopg")
with require_extra("store", "the register needs SQLAlchemy and Alembic", _PACKAGES):
    from inercal.laboratory.store.backup import backup_register, restore_register
    from inercal.laboratory.store.certificates import (
        CertificateEntry,
        CertificateFiles,
        CertificateRequest,
    )
    from inercal.laboratory.store.entries import (
        CalibrationEntry,
        FileEntry,
        RunEntry,
        RunFacts,
        SensorEntry,
    )
    from inercal.laboratory.store.history import SensorHistory
    from inercal.laboratory.store.noise_history import NoiseEntry, NoiseTrend, noise_trends
    from inercal.laboratory.store.register import Register

__all__ = [
    "CalibrationEntry",
    "CertificateEntry",
    "CertificateFiles",
    "CertificateRequest",
    "FileEntry",
    "NoiseEntry",
    "NoiseTrend",
    "Register",
    "RunEntry",
    "RunFacts",
    "SensorEntry",
    "SensorHistory",
    "backup_register",
    "noise_trends",
    "restore_register",
]

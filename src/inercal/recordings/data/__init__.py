"""From [data] of a run file to recordings and tables, for all kinds of benches."""

from inercal.recordings.data.data_section import (
    DataSection,
    ReadbackColumn,
    RestsSection,
    unit_size,
)
from inercal.recordings.data.source import EstimatorInput, Source

__all__ = ["DataSection", "EstimatorInput", "ReadbackColumn", "RestsSection", "Source", "unit_size"]

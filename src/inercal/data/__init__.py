"""From [data] of a run file to recordings and tables: what all kinds of benches have in common."""

from inercal.data.section import DataSection, Readback, RestsSection, size_of
from inercal.data.source import EstimatorInput, Source

__all__ = ["DataSection", "EstimatorInput", "Readback", "RestsSection", "Source", "size_of"]

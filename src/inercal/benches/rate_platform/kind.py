"""A rate platform, as a kind of bench."""

from inercal.benches.kind_definition import Kind, Vocabulary
from inercal.benches.rate_platform.bench import RatePlatform
from inercal.benches.rate_platform.report import directions, plots
from inercal.benches.rate_platform.scale_factors import output_tables
from inercal.benches.rate_platform.sections import Pose, RateDwell
from inercal.benches.rate_platform.settings import RatePlatformData, RatePlatformSection, build
from inercal.benches.rate_platform.sheet import sheet
from inercal.benches.rate_platform.simulation import simulate_sections
from inercal.benches.stated_axes import any_axes
from inercal.recordings.data import EstimatorInput, RunBase


def _observe(run: RunBase[RatePlatformData]) -> EstimatorInput:
    """Return the observations from a run; the reader is imported only when it is needed."""
    from inercal.benches.rate_platform.reading import observe

    return observe(run)


KIND = Kind(
    "rate_platform",
    RatePlatform,
    RatePlatformSection,
    RatePlatformData,
    build,
    (RateDwell, Pose),
    _observe,
    simulate_sections,
    words=Vocabulary(row="section", turning_device="table", rows="sections"),
    sensor=any_axes,
    sheet=sheet,
    directions=directions,
    plots=plots,
    tables=output_tables,
)

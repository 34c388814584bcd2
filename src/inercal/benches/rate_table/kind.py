"""A plain rate table, as a kind of bench."""

from inercal.benches.kind_definition import Kind, Vocabulary, simulate_without_sensor
from inercal.benches.rate_table.bench import RateTable
from inercal.benches.rate_table.driving import MOTION_CONTROL
from inercal.benches.rate_table.report import output_tables, plots
from inercal.benches.rate_table.settings import RateTableData, RateTableSection, build
from inercal.benches.rate_table.sheet import sheet
from inercal.benches.rate_table.simulation import simulate_table_motion, table_plan_duration
from inercal.benches.report_data import describe_spin
from inercal.physics.plan import Spin
from inercal.recordings.data import EstimatorInput, RunBase

_UNJUDGED = (
    "the nominal motion (for a tilted state, its norm) minus the motion computed from one reading"
)


def _observe(run: RunBase[RateTableData]) -> EstimatorInput:
    """Return the observations from a run; the reader is imported only when it is needed."""
    from inercal.benches.rate_table.reading import observe

    return observe(run)


KIND = Kind(
    "rate_table",
    RateTable,
    RateTableSection,
    RateTableData,
    build,
    (Spin,),
    _observe,
    simulate_without_sensor(simulate_table_motion),
    table_plan_duration,
    Vocabulary(row="state or mounting", turning_device="table", rows="states", unjudged=_UNJUDGED),
    sheet=sheet,
    plots=plots,
    row=describe_spin,
    tables=output_tables,
    motion_control=MOTION_CONTROL,
)

"""A plain rate table, as a kind of bench."""

from inercal.benches.kind import Kind, Vocabulary, by_motion, when_called
from inercal.benches.rate_table.bench import RateTable
from inercal.benches.rate_table.report import plots
from inercal.benches.rate_table.settings import RateTableData, RateTableSection, build
from inercal.benches.rate_table.sheet import sheet
from inercal.benches.rate_table.simulation import perform_on_table, seconds_on_table
from inercal.benches.rate_table.states import tables
from inercal.benches.report import spin_in_words
from inercal.plan import Spin

_UNJUDGED = (
    "what the bench makes, of a tilted state the norm, minus what the model says of one "
    "mean reading"
)


KIND = Kind(
    "rate_table",
    RateTable,
    RateTableSection,
    RateTableData,
    build,
    (Spin,),
    when_called("inercal.benches.rate_table.reading", "observe"),
    by_motion(perform_on_table),
    seconds_on_table,
    Vocabulary(row="state or mounting", turner="table", rows="states", unjudged=_UNJUDGED),
    sheet=sheet,
    plots=plots,
    row=spin_in_words,
    tables=tables,
)

"""Define [bench] and [data] for a plain rate table, and build the bench in SI."""

from pathlib import Path
from typing import Literal

from pydantic import Field

from inercal.benches.key_declarations import add_bench_keys, build_bench
from inercal.benches.motion_control import AxisMotionLimits
from inercal.benches.rate_table.bench import RateTable
from inercal.physics.section_settings import PLANNING, BenchSection, section_length, si_value
from inercal.recordings.data import DataSection, ReadbackColumn, unit_size


@add_bench_keys(RateTable)
class RateTableSection(BenchSection):
    """Section [bench] for a plain rate table with a fixture, as used for sensors in ship models."""

    kind: Literal["rate_table"]
    radius: str = Field(examples=["250 mm ± 0.3 mm"])
    max_rate: str = Field(
        "90 rpm", description="rate limit of the table", json_schema_extra=PLANNING
    )
    max_acceleration: str = Field("100 °/s²", json_schema_extra=PLANNING)


class RateTableData(DataSection):
    """Section [data] for a plain rate table, in which each row is a mounting at a rate."""

    arm_rate: str | int = Field(description="column of the table's rate", examples=["rate"])
    arm_rate_unit: str = Field(
        "rpm", description="unit of the rate, or its size such as '0.5 rev/s'"
    )
    mounting: str | int = Field(
        description="column of mountings, 'XY' or 'ZY 30'", examples=["mounting"]
    )

    @property
    def row(self) -> str | int | None:
        """The column that names the rows of a table or the sections of a recording."""
        return self.mounting if self.label is None else self.label

    def readback(self, bench: RateTable) -> tuple[ReadbackColumn, ...]:
        """Return the column with the rate of the table."""
        size = unit_size(self.arm_rate_unit, "rad/s", "arm_rate_unit")
        return (ReadbackColumn("arm_rate", str(self.arm_rate), size),)


def build(section: RateTableSection, folder: Path) -> RateTable:
    """Build the bench in SI from its section; the files that it names are in `folder`."""
    limits = AxisMotionLimits(
        si_value(section.max_rate, "rpm", "[bench] max_rate"),
        si_value(section.max_acceleration, "°/s²", "[bench] max_acceleration"),
    )
    radius = section_length(section, "radius")
    return build_bench(RateTable, section, radius=radius, limits=limits)

"""Table and IMU asked who they are, before a run: nothing moves."""

from collections.abc import Callable
from typing import Any

from inercal.benches.turntable import require_turntable
from inercal.errors import InercalError
from inercal.host import devices
from inercal.host.device_description import imu_lines, table_lines
from inercal.host.web.device_catalogue import SIMULATED, DeviceCatalogue
from inercal.host.web.json_objects import JsonObject, as_object
from inercal.host.web.plans import Plan
from inercal.runfile import read

_SIMULATED = {"ok": True, "lines": ["simulated: made when the run starts"]}


def probe_devices(choice: DeviceCatalogue, plan: Plan | None, asked: JsonObject) -> dict[str, Any]:
    """Return what table and IMU say of themselves, as lines, and whether they could be asked."""
    bench = None
    if plan is not None and not plan.summary["trouble"]:
        bench = require_turntable(read(plan.path))  # a plan of another bench has trouble

    def table() -> list[str]:
        return table_lines(devices.probe_table(choice.table(asked.get("table")), bench))

    def imu() -> list[str]:
        return imu_lines(devices.probe_imu(choice.imu(asked.get("imu"), preset_needed=False)))

    return {
        what: _SIMULATED if _is_simulated(asked.get(what)) else _probe_result(lines)
        for what, lines in (("table", table), ("imu", imu))
    }


def _probe_result(lines: Callable[[], list[str]]) -> dict[str, Any]:
    try:
        return {"ok": True, "lines": lines()}
    except InercalError as error:
        return {"ok": False, "lines": [str(error)]}


def _is_simulated(asked: object) -> bool:
    return (as_object(asked) or {}).get("id") == SIMULATED

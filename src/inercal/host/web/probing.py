"""Table and IMU asked who they are, before a run: nothing moves."""

from collections.abc import Callable
from typing import Any

from inercal.benches.turntable import turntable_of
from inercal.errors import InercalError
from inercal.host import devices
from inercal.host.device_lines import of_imu, of_table
from inercal.host.web.choice import SIMULATED, Choice
from inercal.host.web.plans import Plan
from inercal.host.web.requests import Asked, as_object
from inercal.runfile import read

_SIMULATED = {"ok": True, "lines": ["simulated: made when the run starts"]}


def probe(choice: Choice, plan: Plan | None, asked: Asked) -> dict[str, Any]:
    """Return what table and IMU say of themselves, as lines, and whether they could be asked."""
    bench = None
    if plan is not None and not plan.shown["trouble"]:
        bench = turntable_of(read(plan.path))  # a plan of another bench has trouble

    def table() -> list[str]:
        return of_table(devices.table(choice.table(asked.get("table")), bench))

    def imu() -> list[str]:
        return of_imu(devices.imu(choice.imu(asked.get("imu"), preset_needed=False)))

    return {
        what: _SIMULATED if _is_simulated(asked.get(what)) else _said(lines)
        for what, lines in (("table", table), ("imu", imu))
    }


def _said(lines: Callable[[], list[str]]) -> dict[str, Any]:
    try:
        return {"ok": True, "lines": lines()}
    except InercalError as error:
        return {"ok": False, "lines": [str(error)]}


def _is_simulated(asked: object) -> bool:
    return (as_object(asked) or {}).get("id") == SIMULATED

"""`inercal bench devices` and `check-driver`: query devices, and check a driver."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from inercal.basics.errors import InputError
from inercal.cli import console
from inercal.cli.options import Json, positive_number

if TYPE_CHECKING:
    from inercal.benches.motion_control import ControlledBench

TABLE_HELP = (
    "pmac://HOST:1025?motors=1,2,3&counts=3600000, acutrol://…?axes=1,2,3 or motor:serial:…"
)
_CHAMBER_HELP = "scpi-chamber://HOST?output=1&low=-40&high=130 or watlow-f4t://HOST?event=1"
_BenchRun = Annotated[
    Path | None,
    typer.Option("--run", "-r", help="Run file whose bench names the axes of the table."),
]


def devices(
    table: str = typer.Option("", help=f"Query a table: {TABLE_HELP}"),
    imu: str = typer.Option(
        "", help="Listen to an IMU for one second; without preset=, try every preset."
    ),
    chamber: str = typer.Option("", help=f"Query a chamber: {_CHAMBER_HELP}"),
    run_file: _BenchRun = None,
    json: Json = False,
) -> None:
    """List serial ports, IMU packets, and the state of a table or chamber; nothing moves."""
    from inercal.host import devices as host_devices
    from inercal.host.devices import chamber_lines, imu_lines, port_lines, table_lines

    if run_file is not None and not table:
        raise InputError("--run works only with --table: add --table, or remove --run", key="--run")
    content: dict[str, object] = {}
    lines: list[str] = []
    if not (table or imu or chamber):
        ports = host_devices.list_serial_ports()
        content["ports"] = [asdict(port) for port in ports]
        lines += port_lines(ports)
    if table:
        seen = host_devices.probe_table(table, _bench_of(run_file))
        content["table"] = asdict(seen)
        lines += table_lines(seen)
    if imu:
        reply = host_devices.probe_imu(imu)
        content["imu"] = {
            "address": reply.address,
            "bytes": reply.size,
            "seconds": reply.seconds,
            "packets": [
                {
                    "preset": decoding.layout.name,
                    "protection": decoding.layout.protection,
                    "taken": decoding.decoded_fraction,
                    "rate_hz": decoding.rate_hz,
                }
                for decoding in reply.decodings
            ],
        }
        lines += imu_lines(reply)
    if chamber:
        found = host_devices.probe_chamber(chamber)
        content["chamber"] = {"address": chamber, "state": asdict(found)}
        lines += chamber_lines(chamber, found)
    if json:
        console.print_json(content)
        return
    for line in lines:
        print(line)


def check_driver(
    address: str = typer.Argument(
        help="Address of a simulated table or chamber on this machine, or of an instrument."
    ),
    run_file: _BenchRun = None,
    pace: float = typer.Option(
        1.0, help="Simulated seconds per second, as the simulator was started."
    ),
    overload: str = typer.Option("", help="Address at which an instrument reports an overload."),
    json: Json = False,
) -> None:
    """Check the driver of a table or chamber with its simulator, or that of an instrument.

    The check of a table or chamber moves it and breaks its link. The check of an instrument only
    takes readings. The exit status is 1 if a check fails.
    """
    from time import monotonic

    from inercal.host import driver_check

    positive_number("--pace", str(pace))
    with console.progress_status("checking the driver") as update:
        bench, now = _bench_of(run_file), lambda: pace * monotonic()
        results = driver_check.check_driver(
            address, bench, now=now, begin=update, overloaded=overload
        )
    if json:
        console.print_json([result._asdict() for result in results])
    else:
        rows = ((r.name, "pass" if r.passed else "FAIL *", r.reason) for r in results)
        console.print_table(("check", "result", "found"), rows, title=address)
    console.exit_if(not all(result.passed for result in results), 1)


def _bench_of(run_file: Path | None) -> "ControlledBench | None":
    """Return the bench of a run file; None without one."""
    from inercal.host.tasks import host_plan
    from inercal.runfile import read

    return None if run_file is None else host_plan(read(run_file)).bench

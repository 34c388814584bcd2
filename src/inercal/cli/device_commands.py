"""`inercal bench devices` and `check-driver`: query devices, and check the driver of a table."""

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
_BenchRun = Annotated[
    Path | None,
    typer.Option("--run", "-r", help="Run file whose bench names the axes of the table."),
]


def devices(
    table: Annotated[str, typer.Option(help=f"Query a table: {TABLE_HELP}")] = "",
    imu: Annotated[
        str,
        typer.Option(help="Listen to an IMU for one second; without preset=, try every preset."),
    ] = "",
    run_file: _BenchRun = None,
    json: Json = False,
) -> None:
    """List the serial ports, an IMU's packets and a table's settings, without any motion."""
    from inercal.host import devices as host_devices
    from inercal.host.devices import imu_lines, port_lines, table_lines

    if run_file is not None and not table:
        raise InputError("--run works only with --table: add --table, or remove --run", key="--run")
    content: dict[str, object] = {}
    lines: list[str] = []
    if not (table or imu):
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
    if json:
        console.print_json(content)
        return
    for line in lines:
        print(line)


def check_driver(
    address: Annotated[
        str,
        typer.Argument(
            help="Address of a simulated table on this machine, or of an instrument, by the "
            "driver's scheme."
        ),
    ],
    run_file: _BenchRun = None,
    pace: Annotated[
        float, typer.Option(help="Simulated seconds per second, as the simulator was started.")
    ] = 1.0,
    overload: Annotated[
        str, typer.Option(help="Address at which an instrument reports an overload.")
    ] = "",
    json: Json = False,
) -> None:
    """Check the driver of a table against its simulator, or that of an instrument.

    The check of a table moves it and breaks its link. The check of an instrument only takes
    readings, and needs neither --run nor --pace. The exit status is 1 if a check fails.
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
    if not all(result.passed for result in results):
        raise typer.Exit(1)


def _bench_of(run_file: Path | None) -> "ControlledBench | None":
    """Return the bench of a run file; None without one."""
    from inercal.host.tasks import host_plan
    from inercal.runfile import read

    return None if run_file is None else host_plan(read(run_file)).bench

"""`inercal bench devices`: the connected ports, tables and IMUs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from inercal.cli.bench_options import TABLE_HELP
from inercal.cli.console import print_json

if TYPE_CHECKING:
    from inercal.benches.motion_control import ControlledBench


def devices(
    table: Annotated[str, typer.Option(help=f"Query a table: {TABLE_HELP}")] = "",
    imu: Annotated[
        str,
        typer.Option(help="Listen to an IMU for a second; without preset= every preset is tried."),
    ] = "",
    run_file: Annotated[
        Path | None,
        typer.Option("--run", "-r", help="Run file whose bench names the axes of the table."),
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object instead of a table.")
    ] = False,
) -> None:
    """List serial ports, packets of an IMU and settings of a table. Nothing moves."""
    from dataclasses import asdict

    from inercal.basics.errors import InputError
    from inercal.host import devices
    from inercal.host.devices import imu_lines, port_lines, table_lines

    if run_file is not None and not table:
        raise InputError("--run names the axes of a table: add --table, or remove it", key="--run")
    content: dict[str, object] = {}
    lines: list[str] = []
    if not (table or imu):
        ports = devices.list_serial_ports()
        content["ports"] = [asdict(port) for port in ports]
        lines += port_lines(ports)
    if table:
        seen = devices.probe_table(table, _read_bench(run_file))
        content["table"] = asdict(seen)
        lines += table_lines(seen)
    if imu:
        reply = devices.probe_imu(imu)
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
        print_json(content)
        return
    for line in lines:
        print(line)


def _read_bench(run_file: Path | None) -> "ControlledBench | None":
    from inercal.host.tasks import host_plan
    from inercal.runfile import read

    return None if run_file is None else host_plan(read(run_file)).bench

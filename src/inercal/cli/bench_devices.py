"""`inercal bench devices`: what is connected, and what it says of itself."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from inercal.cli.bench_options import TABLE_HELP
from inercal.cli.console import print_json

if TYPE_CHECKING:
    from inercal.benches import Turntable


def devices(
    table: Annotated[str, typer.Option(help=f"Ask a table: {TABLE_HELP}")] = "",
    imu: Annotated[
        str, typer.Option(help="Listen to an IMU for a second; without preset= all are tried.")
    ] = "",
    run_file: Annotated[
        Path | None, typer.Option("--run", "-r", help="Run file whose bench names the axes.")
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object instead of a table.")
    ] = False,
) -> None:
    """Say what is connected: serial ports, what an IMU sends, how a table is set. Nothing moves."""
    from dataclasses import asdict

    from inercal.host import devices
    from inercal.host.device_description import imu_lines, port_lines, table_lines

    found: dict[str, object] = {}
    if not (table or imu):
        ports = devices.list_serial_ports()
        found["ports"] = [asdict(port) for port in ports]
        lines = port_lines(ports)
    else:
        lines = []
    if table:
        seen = devices.probe_table(table, _read_bench(run_file))
        found["table"] = asdict(seen)
        lines += table_lines(seen)
    if imu:
        heard = devices.probe_imu(imu)
        found["imu"] = {
            "address": heard.address,
            "bytes": heard.size,
            "seconds": heard.seconds,
            "packets": [
                {
                    "preset": one.layout.name,
                    "protection": one.layout.protection,
                    "taken": one.decoded_fraction,
                    "rate_hz": one.rate_hz,
                }
                for one in heard.decodings
            ],
        }
        lines += imu_lines(heard)
    if json:
        print_json(found)
        return
    for line in lines:
        print(line)


def _read_bench(run_file: Path | None) -> "Turntable | None":
    from inercal.benches.turntable import require_turntable
    from inercal.runfile import read

    return None if run_file is None else require_turntable(read(run_file))

"""`inercal bench devices`: what is connected, and what it says of itself."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from inercal.cli.bench_options import TABLE
from inercal.cli.show import as_json

if TYPE_CHECKING:
    from inercal.benches import Turntable


def devices(
    table: Annotated[str, typer.Option(help=f"Ask a table: {TABLE}")] = "",
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
    from inercal.host.device_lines import of_imu, of_ports, of_table

    found: dict[str, object] = {}
    if not (table or imu):
        ports = devices.ports()
        found["ports"] = [asdict(port) for port in ports]
        lines = of_ports(ports)
    else:
        lines = []
    if table:
        seen = devices.table(table, _bench(run_file))
        found["table"] = asdict(seen)
        lines += of_table(seen)
    if imu:
        heard = devices.imu(imu)
        found["imu"] = {
            "address": heard.address,
            "bytes": heard.size,
            "seconds": heard.seconds,
            "packets": [
                {
                    "preset": one.layout.name,
                    "protection": one.layout.protection,
                    "taken": one.taken,
                    "rate_hz": one.rate_hz,
                }
                for one in heard.senders
            ],
        }
        lines += of_imu(heard)
    if json:
        as_json(found)
        return
    for line in lines:
        print(line)


def _bench(run_file: Path | None) -> "Turntable | None":
    from inercal.benches.turntable import turntable_of
    from inercal.runfile import read

    return None if run_file is None else turntable_of(read(run_file))

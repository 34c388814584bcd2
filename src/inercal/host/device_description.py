"""Lines of text that describe the connected devices."""

from collections.abc import Sequence
from math import degrees, isfinite

from inercal.host.devices import ImuConnection, SerialPort, TableConnection


def port_lines(ports: Sequence[SerialPort]) -> list[str]:
    """Return lines about the serial ports there are."""
    if not ports:
        return ["no serial port; ask a table or an IMU by its address: --table, --imu"]
    return [f"{port.address}  {port.description}" for port in ports]


def imu_lines(imu: ImuConnection) -> list[str]:
    """Return lines about what an IMU sends."""
    lines = [f"{imu.address}: {imu.size} bytes in {imu.seconds:.1f} s"]
    if not imu.size:
        return [
            *lines,
            "  it sends nothing: is it switched on, are baud and wiring right? (A simulated one "
            "whose time is granted waits for a run: simulate --pace 1.)",
        ]
    if not imu.decodings:
        return [
            *lines,
            "  no preset reads them: try another baud, or describe it, layout=FILE.toml",
        ]
    return lines + [
        f"  preset={one.layout.name}: {one.rate_hz:.6g} packets a second, "
        f"{100 * one.decoded_fraction:.3g} % of the bytes taken, {one.counts.failed} wrong checks; "
        f"{one.layout.protection}"
        for one in imu.decodings
    ]


def table_lines(table: TableConnection) -> list[str]:
    """Return lines about a table."""
    state = table.state
    lines = [f"{table.address}: {table.identity or 'does not say what it is'}"]
    for name, limit, axis in zip(table.axes, table.limits, state.axes, strict=True):
        soft = (
            f"soft limits {degrees(limit.low):.6g} to {degrees(limit.high):.6g} °"
            if isfinite(limit.low) or isfinite(limit.high)
            else "no soft limits"
        )
        servo = "servo on" if axis.enabled else "servo off"
        homed = "homed" if axis.homed else "not homed"
        lines.append(
            f"  {name}: at {degrees(axis.angle):.4f} °, {servo}, {homed}; up to "
            f"{degrees(limit.rate):.6g} °/s and {degrees(limit.acceleration):.6g} °/s², {soft}, "
            f"following error {degrees(limit.following_error):.6g} °"
            + (f"; {', '.join(axis.faults)}" if axis.faults else "")
        )
    if isfinite(table.wrap_period):
        lines.append(f"  its clock begins again after {table.wrap_period:.0f} s")
    return lines

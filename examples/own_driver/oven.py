"""Driver for an oven that is controlled by lines of text, at addresses such as `oven://10.0.0.8`.

Each line and each reply ends with LF:

    ID         OVEN-1           name
    TEMP?      24.9             temperature of the air, °C
    SET 60.0   OK               goes to a set point, °C
    OFF        OK               ends heating
    DOOR?      CLOSED           or OPEN
    FAULT?     NONE             or HOT, if the limiter has tripped
"""

from inercal.host.drivers.scpi_chamber import ChamberDialect, Exchange, ScpiChamber
from inercal.host.drivers.table_address import TableAddress

OVEN = ChamberDialect(
    port=4001,
    ending="\n",
    parameters={},
    begin=Exchange("ID", "OVEN-1"),
    temperature=Exchange("TEMP?", r"(?P<value>-?\d+\.\d+)"),
    go=Exchange("SET {celsius:.1f}", "OK"),
    stop=Exchange("OFF", "OK"),
    door=Exchange("DOOR?", "CLOSED|(?P<bad>OPEN)"),
    alarms={"too hot": Exchange("FAULT?", "NONE|(?P<bad>HOT)")},
)


def open_oven(address: str, timeout: float) -> ScpiChamber:
    """Open the oven at an address; it goes to 5 °C to 200 °C."""
    link = TableAddress(address, "oven://HOST", OVEN.port).link()
    return ScpiChamber(link, OVEN, {"low": 5.0, "high": 200.0}, timeout)

"""A simulated chamber with the SCPI commands of a Watlow F4T, in °C or °F.

A command has no reply, and a line that is not understood is ignored. Output 1 switches the chamber
on, output 7 reports alarms, and output 8 reports that the door is open.

Run it as `python -m inercal.host.sim.scpi_chamber --port 5025 --pace 60`.
"""

from argparse import ArgumentParser
from math import isfinite, isnan

from inercal.basics.errors import InputError
from inercal.basics.units import ZERO_CELSIUS
from inercal.host.sim.chamber import SimulatedChamber
from inercal.host.sim.dynamics import LineSession
from inercal.host.sim.faults import parse_number
from inercal.host.sim.server import add_pace_option, selected_pace, serve


class SimulatedScpiChamber:
    """A `server.Device` that controls a `SimulatedChamber`.

    Parameters
    ----------
    options
        Keyword arguments of `SimulatedChamber`.

    Attributes
    ----------
    time : float
        Bench time, s.
    chamber : SimulatedChamber
    """

    def __init__(self, **options: float):
        self.time = 0.0
        self.chamber = SimulatedChamber(lambda: self.time, **options)
        self._unit, self._set_point, self._on = "F", self.chamber.read().temperature, False

    def driver_address(self, link: str) -> str:
        """Return the address with which a driver opens this chamber, which is served at a link."""
        ends = (f"{end - ZERO_CELSIUS:.6g}" for end in (self.chamber.low, self.chamber.high))
        return "scpi-chamber:{}?output=1&low={}&high={}&door=8&alarm=7".format(
            link.removeprefix("tcp:"), *ends
        )

    def advance(self, until: float) -> None:
        """Let bench time pass up to `until`, s."""
        self.time = max(self.time, until)

    def session(self) -> LineSession:
        """Return the controller's side of a new connection."""
        return LineSession(b"\n", self._answer_line)

    def fault(self, words: str) -> None:
        """Set a fault of the chamber; see `SimulatedChamber.fault`."""
        self.chamber.fault(words)

    def _answer_line(self, line: str) -> str:
        if "silent" in self.chamber.faults:
            return ""
        reply = self._reply(line.upper().split())
        return "" if reply is None else f"{reply}\n"

    def _reply(self, words: list[str]) -> str | None:
        match words:
            case ["*IDN?"]:
                return "inercal,simulated F4T"
            case [":UNIT:TEMPERATURE?"]:
                return self._unit
            case [":UNIT:TEMPERATURE", "C" | "F" as unit]:
                self._unit = unit
            case [":SOURCE:CLOOP1:PVALUE?"]:
                return self._shown(self.chamber.read().temperature)
            case [":SOURCE:CLOOP1:SPOINT?"]:
                return self._shown(self._set_point)
            case [":SOURCE:CLOOP1:ERROR?"]:
                return "ERROR" if isnan(self.chamber.read().temperature) else "NONE"
            case [":SOURCE:CLOOP1:SPOINT", text] if isfinite(value := parse_number(text)):
                value = value if self._unit == "C" else (value - 32) / 1.8
                self._set_point = value + ZERO_CELSIUS
                self._control()
            case [":OUTPUT1:STATE", "ON" | "OFF" as state]:
                self._on = state == "ON"
                self._control()
            case [":OUTPUT1:STATE?"]:
                return "ON" if self._on else "OFF"
            case [":OUTPUT7:STATE?"]:
                return "ON" if self.chamber.read().alarms else "OFF"
            case [":OUTPUT8:STATE?"]:
                return "ON" if self.chamber.read().door_open else "OFF"
            case _:
                pass
        return None

    def _shown(self, kelvin: float) -> str:
        celsius = kelvin - ZERO_CELSIUS
        return f"{celsius if self._unit == 'C' else 1.8 * celsius + 32:.4f}"

    def _control(self) -> None:
        low, high = self.chamber.low, self.chamber.high
        self._set_point = min(max(self._set_point, low), high)
        if self._on:
            self.chamber.set_temperature(self._set_point)
        else:
            self.chamber.stop()


def main() -> None:
    """Serve a simulated chamber until standard input ends; see `server.serve`."""
    parser = ArgumentParser(prog="python -m inercal.host.sim.scpi_chamber", description=__doc__)
    parser.add_argument("--port", type=int, default=0, help="port; 0 selects any free one")
    add_pace_option(parser)
    options = parser.parse_args()
    serve(SimulatedScpiChamber(), selected_pace(options), options.port)


if __name__ == "__main__":
    main()

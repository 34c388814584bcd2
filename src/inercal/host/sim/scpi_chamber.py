"""A simulated chamber with the SCPI commands of a Watlow F4T, in °C or °F.

A command has no reply, and a line that is not understood is ignored. Output 1 switches the chamber
on, output 7 reports alarms, and output 8 reports that the door is open.

Run it as `python -m inercal.host.sim.scpi_chamber --port 5025 --pace 60`.
"""

from argparse import ArgumentParser
from math import isfinite, isnan

from inercal.basics.units import ZERO_CELSIUS
from inercal.host.sim.chamber import SimulatedChamber
from inercal.host.sim.dynamics import LineSession
from inercal.host.sim.faults import parse_number
from inercal.host.sim.server import add_pace_option, selected_pace, serve


class SimulatedScpiChamber(SimulatedChamber):
    """A `server.Device`; the keyword arguments are those of `SimulatedChamber`.

    Attributes
    ----------
    time : float
        Bench time, s.
    """

    def __init__(self, **options: float):
        self.time = 0.0
        super().__init__(lambda: self.time, **options)
        self._unit, self._is_on, self._goal = "F", False, self.read().temperature

    def driver_address(self, link: str) -> str:
        """Return the address with which a driver opens this chamber, which is served at a link."""
        ends = (f"{end - ZERO_CELSIUS:.6g}" for end in (self.low, self.high))
        return "scpi-chamber:{}?output=1&low={}&high={}&door=8&alarm=7".format(
            link.removeprefix("tcp:"), *ends
        )

    def advance(self, until: float) -> None:
        """Let bench time pass up to `until`, s."""
        self.time = max(self.time, until)

    def session(self) -> LineSession:
        """Return the controller's side of a new connection."""
        return LineSession(b"\n", self._answer_line)

    def _answer_line(self, line: str) -> str:
        if "silent" in self.faults:
            return ""
        state, celsius = self.read(), self._unit == "C"
        match line.upper().split():
            case [":UNIT:TEMPERATURE?"]:
                return f"{self._unit}\n"
            case [":SOURCE:CLOOP1:PVALUE?"]:
                value = state.temperature - ZERO_CELSIUS
                return f"{value if celsius else 1.8 * value + 32:.4f}\n"
            case [":SOURCE:CLOOP1:ERROR?"]:
                return "ERROR\n" if isnan(state.temperature) else "NONE\n"
            case [":OUTPUT1:STATE?" | ":OUTPUT7:STATE?" | ":OUTPUT8:STATE?" as query]:
                flags = {"1": self._is_on, "7": state.alarms, "8": state.door_open}
                return "ON\n" if flags[query[7]] else "OFF\n"
            case [":UNIT:TEMPERATURE", "C" | "F" as unit]:
                self._unit = unit
            case [":SOURCE:CLOOP1:SPOINT", text] if isfinite(value := parse_number(text)):
                goal = (value if celsius else (value - 32) / 1.8) + ZERO_CELSIUS
                self._goal = min(max(goal, self.low), self.high)
            case [":OUTPUT1:STATE", "ON" | "OFF" as output]:
                self._is_on = output == "ON"
            case _:
                return ""
        if self._is_on:
            self.set_temperature(self._goal)
        else:
            self.stop()
        return ""


def main() -> None:
    """Serve a simulated chamber until standard input ends; see `server.serve`."""
    parser = ArgumentParser(prog="python -m inercal.host.sim.scpi_chamber", description=__doc__)
    parser.add_argument("--port", type=int, default=0, help="port; 0 selects any free one")
    add_pace_option(parser)
    options = parser.parse_args()
    serve(SimulatedScpiChamber(), selected_pace(options), options.port)


if __name__ == "__main__":
    main()

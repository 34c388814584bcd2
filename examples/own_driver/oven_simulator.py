"""A simulated oven, which shares no code with its driver.

Run it as `python -m oven_simulator --port 4001 --pace 100`.
"""

from inercal.host.sim.chamber import SimulatedChamber
from inercal.host.sim.dynamics import LineSession
from inercal.host.sim.server import serve, simulator_parser


class SimulatedOven(SimulatedChamber):
    """The oven's controller and its air."""

    def __init__(self) -> None:
        self.time = 0.0
        super().__init__(lambda: self.time, ramp=0.1, low=278.15, high=473.15)

    def advance(self, until: float) -> None:
        """Let bench time pass up to `until`, s."""
        self.time = max(self.time, until)

    def session(self) -> LineSession:
        """Return a new session, for a new connection."""
        return LineSession(b"\n", lambda line: f"{self._answer(line)}\n")

    def _answer(self, line: str) -> str:
        state = self.read()
        match line.split():
            case ["ID"]:
                return "OVEN-1"
            case ["TEMP?"]:
                return f"{state.temperature - 273.15:.1f}"
            case ["SET", celsius]:
                self.set_temperature(float(celsius) + 273.15)
                return "OK"
            case ["OFF"]:
                self.stop()
                return "OK"
            case ["DOOR?"]:
                return "OPEN" if state.door_open else "CLOSED"
            case ["FAULT?"]:
                return "HOT" if state.alarms else "NONE"
            case _:
                return "ERR"


if __name__ == "__main__":
    parser = simulator_parser("python -m oven_simulator", __doc__, 4001)
    serve(SimulatedOven(), parser.parse_args())

"""A simulated spindle; it imports nothing from the driver, so a mistake in one is not in both.

Run it as `python -m spindle_simulator --port 4000`.
"""

from math import degrees, radians

from inercal.host.sim.dynamics import AxisDynamics, Controller, LineSession, SimulatedTable
from inercal.host.sim.faults import parse_number
from inercal.host.sim.server import serve, simulator_parser

_RATE, _ACCELERATION, _END = 120.0, 240.0, 720.0  # °/s, °/s², °


class SimulatedSpindle(Controller):
    """A spindle that starts at 20°, with its servo on."""

    def __init__(self):
        axis = AxisDynamics("spindle", start=radians(20.0))
        super().__init__(SimulatedTable([axis], 1000.0))
        self._axis = self.table.state[0]
        self._axis.zero = 0.0
        self.table.enable(0)

    def session(self) -> LineSession:
        """Return a new session, for a new connection."""
        return LineSession(b"\n", lambda line: f"{self._answer(line)}\n")

    def _answer(self, line: str) -> str:
        word, *texts = line.split() or [""]
        numbers = [parse_number(text) for text in texts]
        match word, numbers:
            case "ID", []:
                return f"SPINDLE-1 {_RATE:g} {_ACCELERATION:g} {-_END:g} {_END:g}"
            case "STATE", []:
                report = self.table.report()[0]
                turns = "turns" if self.table.is_moving(0) else "holds"
                state = turns if self._axis.closed else "fault"
                return (
                    f"{self.time:.3f} {degrees(report.reading):.4f} {degrees(report.rate):.4f} "
                    f"{state}"
                )
            case "STOP", []:
                self.table.halt(0)
                return "OK"
            case "MOVE", [angle, rate, acceleration] if abs(angle) <= _END and rate > 0:
                return self._turn(rate, acceleration, goal=angle)
            case "SPIN", [rate, acceleration]:
                return self._turn(rate, acceleration)
        return "ERR unknown command"

    def _turn(self, rate: float, acceleration: float, goal: float | None = None) -> str:
        if not (abs(rate) <= _RATE and 0 < acceleration <= _ACCELERATION):
            return "ERR out of range"
        if not self._axis.closed:
            return "ERR drive fault"
        self._axis.speed = radians(abs(rate))
        self._axis.acceleration = radians(acceleration)
        if goal is not None:
            self.table.move_axis(0, radians(goal))
        elif rate == 0:
            self.table.halt(0)
        else:
            self.table.rotate_axis(0, 1.0 if rate > 0 else -1.0)
        return "OK"


def main() -> None:
    """Serve a simulated spindle until standard input ends."""
    parser = simulator_parser("python -m spindle_simulator", __doc__, 4000)
    serve(SimulatedSpindle(), parser.parse_args())


if __name__ == "__main__":
    main()

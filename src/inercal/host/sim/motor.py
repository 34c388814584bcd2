"""A simulated motor of a rate table: each ASCII line gets a reply that ends with the prompt `>`.

Run it as `python -m inercal.host.sim.motor`, on a pseudo-terminal, or with `--port` over TCP.
"""

from math import degrees, isfinite, radians

from inercal.host.sim.dynamics import AxisDynamics, Controller, LineSession, SimulatedTable
from inercal.host.sim.faults import parse_number
from inercal.host.sim.server import serve, simulator_parser

_LIMITS = {"JOG": 600.0, "VEL": 600.0, "ACL": 200.0}  # °/s, °/s²


class SimulatedMotor(Controller):
    """A motor that turns the table at up to 600 °/s; its servo is always on."""

    def __init__(self):
        axis = AxisDynamics("table", start=1.2, omega=25.0, feedforward=0.9)
        super().__init__(SimulatedTable([axis], 1000.0))
        self.table.state[0].fatal = radians(10.0)
        self.table.enable(0)

    def session(self) -> LineSession:
        """Return a new session of the controller, for a new connection."""
        return LineSession(b"\r", self._answer_line)

    def _answer_line(self, line: str) -> str:
        x = self.table.state[0]
        if not x.closed and not line.startswith("P"):
            return "? drive fault\r\n>"
        match line.upper().split():
            case []:
                pass
            case ["PPO"]:
                return f"{degrees(self.table.reading(0)):.4f}\r\n>"
            case ["PVE"]:
                return f"{degrees(float(x.encoder_rate)):.4f}\r\n>"
            case ["STO"]:
                self.table.halt(0)
            case ["HOM"]:
                x.speed = radians(20.0)
                self.table.search(0)
            case ["ACL" | "VEL" | "JOG" | "POS" as what, text] if isfinite(parse_number(text)):
                value = float(text)
                if abs(value) > _LIMITS.get(what, 1e9) or (what in ("ACL", "VEL") and value <= 0):
                    return "? range\r\n>"
                self._set_value(what, radians(value))
            case _:
                return "? command\r\n>"
        return "\r\n>"

    def _set_value(self, what: str, value: float) -> None:
        x = self.table.state[0]
        if what == "ACL":
            x.acceleration = x.abort = value
        elif what == "VEL":
            x.speed = value
        elif what == "POS":
            self.table.move_axis(0, value)
        elif value == 0:
            self.table.halt(0)
        else:
            x.speed = abs(value)
            self.table.rotate_axis(0, 1.0 if value > 0 else -1.0)


def main() -> None:
    """Serve a simulated motor until standard input ends; see `server.serve`."""
    parser = simulator_parser("python -m inercal.host.sim.motor", __doc__, None)
    serve(SimulatedMotor(), parser.parse_args())


if __name__ == "__main__":
    main()

"""A simulated ACUTROL3000 controller with SCPI-like lines over TCP, in degrees.

The replies to several queries in one line are separated by `;`. A header without its first colon
continues at the level of the previous one. `*stb?` returns 65 if an interlock has a fault, and 4
after an error.

Run as `python -m inercal.host.sim.acutrol`.
"""

import re
from math import degrees, inf, radians

from inercal.host.sim import dynamics
from inercal.host.sim.server import serve, simulator_parser

_WORDS = ("mode", "demand", "read", "limit", "interlock", "position", "rate", "acceleration",
          "absolute", "close", "open", "reset", "off")  # fmt: skip
_LIMITS = {"rate": 400.0, "acceleration": 500.0}  # °/s, °/s²
_JERK = 10000.0  # °/s³; reported, but not enforced


class _CommandError(Exception):
    """A command that the controller refuses."""


class SimulatedAcutrol(dynamics.Controller):
    """A simulated ACUTROL3000; channel 1 is the outermost axis, and rates are in °/s."""

    def __init__(self):
        super().__init__(dynamics.SimulatedTable(dynamics.three_axes(), 2000.0))
        count = len(self.table.axes)
        self._mode = ["off"] * count
        self._demand = [{"position": 0.0, "rate": 0.0} for _ in range(count)]
        self._limit = [
            {(mode, what): most for mode in ("position", "rate") for what, most in _LIMITS.items()}
            for _ in range(count)
        ]
        self._error = False
        for x in self.table.state:
            # The encoders are absolute, so the zero is at a fixed position of the axis.
            x.zero, x.homed, x.fatal, x.band = 0.0, 1, radians(2.0), radians(1e-4)

    def session(self) -> dynamics.LineSession:
        """Return the controller's side of a new connection."""
        return dynamics.LineSession(b"\n", self._answer_line)

    def _answer_line(self, line: str) -> str:
        said: list[str] = []
        path: list[str] = []
        for command in filter(None, (part.strip().lower() for part in line.split(";"))):
            try:
                answer = self._common_command(command)
                if answer is None:
                    header, _, rest = command.partition(" ")
                    words = [
                        _expand_word(w) for w in header.removesuffix("?").strip(":").split(":")
                    ]
                    words = words if header.startswith(":") else [*path, *words]
                    path = words[:-1]
                    answer = self._command(words, header.endswith("?"), rest.split(","))
            except (_CommandError, ValueError, IndexError):
                self._error = True
                continue
            if answer:
                said.append(answer)
        return ";".join(said) + "\n" if said else ""

    def _common_command(self, command: str) -> str | None:
        if command == "*idn?":
            return "inercal,simulated ACUTROL3000"
        if command == "*stb?":
            fault = any(self._interlock(i) == "Fault" for i in range(len(self._mode)))
            status = 65 * fault + 4 * self._error
            self._error = False
            return str(status)
        return None

    def _command(self, words: list[str], question: bool, given: list[str]) -> str:
        match words, question:
            case ["interlock", "reset"], False:
                for x in self.table.state:
                    x.tripped = 0
                return ""
            case ["limit", "rate" | "acceleration" as what], _:
                mode, i = _expand_word(given[0].strip()), self._axis(given[1])
                if question:
                    return f"{self._limit[i][mode, what]:.6f}"
                value = float(given[2])
                if (mode, what) not in self._limit[i] or not 0 < value <= _LIMITS[what]:
                    raise _CommandError
                self._limit[i][mode, what] = value
                return ""
            case _:
                pass
        i = self._axis(given[0])
        x = self.table.state[i]
        match words, question:
            case ["limit", "absolute"], True:
                ends = (degrees(float(e)) if abs(e) < inf else 1e9 * (1 if e > 0 else -1)
                        for e in (x.low, x.high))  # fmt: skip
                told = (*_LIMITS.values(), _JERK, *ends, 0.0)
                return ",".join(f"{v:.6f}" for v in told)
            case ["read", "position"], True:
                return f"{degrees(self.table.reading(i)):.6f}"
            case ["read", "rate"], True:
                return f"{degrees(float(x.encoder_rate)):.6f}"
            case ["read", "acceleration"], True:
                return f"{degrees(float(x.rotation)):.6f}"
            case ["mode"], True:
                return self._mode[i].capitalize()
            case ["interlock"], True:
                return self._interlock(i)
            case ["interlock", "close"], False:
                self.table.enable(i)
            case ["interlock", "open"], False:
                self.table.kill(i)
                self._mode[i] = "off"
            case ["demand", "position" | "rate" as what], False:
                self._demand[i][what] = float(given[1])
                self._apply_demand(i)
            case ["mode", "position" | "rate" | "off" as mode], False:
                self._mode[i] = mode
                self._apply_demand(i)
            case _:
                raise _CommandError
        return ""

    def _apply_demand(self, i: int) -> None:
        """Start the motion that mode and demand define."""
        mode, x = self._mode[i], self.table.state[i]
        if mode == "off":
            self.table.halt(i)
            return
        limit, demand = self._limit[i], self._demand[i][mode]
        x.acceleration = radians(limit[mode, "acceleration"])
        try:
            if mode == "position":
                x.speed = radians(limit[mode, "rate"])
                self.table.move_axis(i, radians(demand))
            elif demand == 0:
                self.table.halt(i)
            else:
                x.speed = radians(min(abs(demand), limit[mode, "rate"]))
                self.table.rotate_axis(i, 1.0 if demand > 0 else -1.0)
        except dynamics.ServoOffError:
            raise _CommandError from None

    def _interlock(self, i: int) -> str:
        x = self.table.state[i]
        return "Fault" if x.tripped or x.amplifier else "Closed" if x.closed else "Open"

    def _axis(self, text: str) -> int:
        if not re.fullmatch(r"\s*[0-9]\s*", text) or not 1 <= int(text) <= len(self._mode):
            raise _CommandError
        return int(text) - 1


def _expand_word(word: str) -> str:
    """Return the full word for an abbreviation of at least three letters."""
    for full in _WORDS:
        if len(word) >= 3 and full.startswith(word):
            return full
    raise _CommandError


def main() -> None:
    """Serve a simulated ACUTROL3000 until standard input ends; see `server.serve`."""
    parser = simulator_parser("python -m inercal.host.sim.acutrol", __doc__)
    serve(SimulatedAcutrol(), parser.parse_args())


if __name__ == "__main__":
    main()

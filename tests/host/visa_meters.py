"""The simulated voltmeter and counter of the example, which pyvisa-sim serves in this process."""

from collections.abc import Iterable, Mapping
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from pyvisa import ResourceManager
from tests.program import Ended, run_program

MEASURE = Path(__file__).parents[2] / "examples" / "measure"
VOLTMETER = "GPIB0::22::INSTR"
COUNTERS = tuple(f"TCPIP0::10.0.0.{n}::inst0::INSTR" for n in (5, 6, 7))
Input = str | Mapping[str, str]  # of the voltmeter, or by the name of each meter; or a command


class Meters:
    """A library of its own, because pyvisa-sim keeps the state of a file in the process."""

    def __init__(self, folder: Path):
        self.file = folder / "meters.yaml"
        text = (MEASURE / "meters.yaml").read_text(encoding="utf-8")
        more = "".join(f"  {name}:\n    device: counter\n" for name in COUNTERS[1:])
        self.file.write_text(text + more, encoding="utf-8")
        self.visa: Any = ResourceManager(f"{self.file}@sim").visalib

    def voltmeter(self, *options: str) -> str:
        return self._address(VOLTMETER, *options)

    def counter(self, *options: str, name: str = COUNTERS[0]) -> str:
        return self._address(name, "query=MEAS:FREQ?", "unit=Hz", *options)

    def _address(self, name: str, *options: str) -> str:
        return f"visa:{name}?{'&'.join([*options, f'backend={self.file}@sim'])}"

    def show(self, text: str, name: str = VOLTMETER) -> None:
        """Let a meter answer with this text."""
        self.visa.devices[name].write(f"SIM:INPUT {text}\n".encode())

    def lose(self) -> None:
        """End all connections, as an instrument does that is switched off and on."""
        self.visa.sessions.clear()

    def name(self, identity: str) -> None:
        """Let another voltmeter be at the address."""
        self.visa.devices[VOLTMETER]._dialogues[b"*IDN?"] = identity.encode()


class Operator(StringIO):
    """Somebody who applies each input to the meter and then presses Enter, or types a command."""

    def __init__(self, meters: Meters, inputs: Iterable[Input], *, typed: bool):
        super().__init__()
        self._meters, self._inputs, self._typed = meters, iter(inputs), typed

    def isatty(self) -> bool:
        return self._typed

    def readline(self, size: int | None = -1, /) -> str:
        found = next(self._inputs, None)
        if found is None:
            return ""
        if found in ("keep", "quit"):
            return f"{found}\n"
        for name, text in ({VOLTMETER: found} if isinstance(found, str) else found).items():
            self._meters.show(text, name)
        return "\n"


def measure_inputs(
    meters: Meters, inputs: Iterable[Input], *arguments: str | Path, typed: bool = False
) -> Ended:
    """Run the verb with an operator."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.stdin", Operator(meters, inputs, typed=typed))
        return run_program("measure", *arguments)

"""The page about chambers says what the drivers and the simulator do."""

import re
from pathlib import Path

import pytest

from inercal.host.drivers import watlow_f4t
from inercal.host.drivers.scpi_chamber import DIALECTS
from inercal.host.equipment import CHAMBERS
from inercal.host.sim.chamber import FAULTS

TEXT = (Path(__file__).parents[3] / "docs" / "how-to" / "chamber.md").read_text(encoding="utf-8")


def test_the_python_runs(capsys: pytest.CaptureFixture[str]):
    (code,) = re.findall(r"```python\n(.*?)```", TEXT, re.S)
    exec(compile(code, "chamber.md", "exec"), {})
    assert capsys.readouterr().out == "25.0 °C False ()\n"


def test_every_scheme_dialect_and_fault_is_named():
    for scheme in ("scpi-chamber", "watlow-f4t", "sim"):
        assert scheme in CHAMBERS
        assert f"`{scheme}" in TEXT
    for name, dialect in DIALECTS.items():
        for word in (name, *dialect.parameters, "low", "high"):
            assert f"`{word}`" in TEXT, word
        assert str(dialect.port) in TEXT
    for fault in FAULTS:
        assert f"`fault {fault}`, `fault {fault} off`" in TEXT


def test_the_registers_are_those_of_the_driver():
    table = TEXT[TEXT.index("| register |") :].partition("\n\n")[0]
    named = {int(number) for number in re.findall(r"\b\d{4,5}\b", table)}
    registers = {
        watlow_f4t.LOW_LIMIT,
        watlow_f4t.HIGH_LIMIT,
        watlow_f4t.SET_POINT,
        watlow_f4t.MODE,
        watlow_f4t.TEMPERATURE,
        watlow_f4t.UNIT,
        watlow_f4t.ALARM,
        watlow_f4t.ALARM + watlow_f4t.ALARM_STEP,
        *watlow_f4t.EVENTS,
    }
    assert named <= registers
    assert registers - named == {16824, 16826}  # within "16822 to 16828"

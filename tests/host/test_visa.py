"""Voltmeters and counters through PyVISA: readings, wrong replies, loss and addresses."""

import sys
from pathlib import Path

import pytest
from tests.host.guided_runs import serve
from tests.host.visa_meters import COUNTERS, Meters
from tests.refusals import refused

from inercal.basics.errors import InputError, MissingExtra
from inercal.host.drivers.rotary_table import ProtocolError
from inercal.host.equipment import Instrument, Reading, open_instrument
from inercal.host.link import LinkLost


@pytest.fixture
def meters(tmp_path: Path) -> Meters:
    return Meters(tmp_path)


def opened(address: str) -> Instrument:
    return open_instrument(address, 0.05)


def test_a_reading_has_the_stated_unit_and_the_instrument_a_name(meters: Meters):
    meters.show("+1.25000000E+00")
    with opened(meters.voltmeter()) as voltmeter, opened(meters.counter()) as counter:
        assert voltmeter.identity() == "EXAMPLE,VOLTMETER 6,MY0001,1.0"
        assert (voltmeter.read(), counter.read()) == (Reading(1.25, "V"), Reading(35125.0, "Hz"))
        meters.show("3.5E4", COUNTERS[0])
        assert counter.read() == (35000.0, "Hz")


@pytest.mark.parametrize("reply", ["-2.5 V", "-2.5 VDC", "-2.5E0 v"])
def test_a_reply_may_state_its_unit(meters: Meters, reply: str):
    meters.show(reply)
    with opened(meters.voltmeter()) as voltmeter:
        assert voltmeter.read() == (-2.5, "V")


@pytest.mark.parametrize("reply", ["OVLD", "1.2 MV", "1.2 Hz", "1.0,2.0", "nan", "1.2.3"])
def test_a_reply_that_is_not_one_number_in_the_unit_is_refused(meters: Meters, reply: str):
    with opened(meters.voltmeter()) as voltmeter:
        meters.show(reply)
        with refused(ProtocolError, names=(meters.voltmeter(),)):
            voltmeter.read()
        meters.show("0.5")
        assert voltmeter.read().value == 0.5


@pytest.mark.parametrize("reply", ["9.9E37", "+9.90000000E+37", "-9.9E+37", "9.91E37"])
def test_an_overload_is_refused_and_the_reading_can_be_repeated(meters: Meters, reply: str):
    with opened(meters.voltmeter()) as voltmeter:
        meters.show(reply)
        with refused(InputError, names=(meters.voltmeter(),)):
            voltmeter.read()
        meters.show("0.5")
        assert voltmeter.read().value == 0.5


def test_a_query_without_a_reply_times_out(meters: Meters):
    with opened(meters.voltmeter("query=*CLS")) as voltmeter, pytest.raises(LinkLost):
        voltmeter.read()
    with pytest.raises(LinkLost):
        opened(meters.voltmeter("identity=*CLS"))
    with opened(meters.voltmeter("identity=")) as voltmeter:
        assert voltmeter.identity() == ""


def test_a_lost_instrument_is_opened_again_if_it_is_the_same(meters: Meters):
    with opened(meters.voltmeter()) as voltmeter:
        voltmeter.read()
        meters.lose()
        with pytest.raises(LinkLost):
            voltmeter.read()
        assert voltmeter.read().unit == "V"
        meters.lose()
        meters.name("EXAMPLE,VOLTMETER 6,MY0007,1.0")
        with pytest.raises(LinkLost):
            voltmeter.read()
        for _ in range(2):
            with refused(InputError, names=(meters.voltmeter(),)):
                voltmeter.read()


def test_an_instrument_that_is_not_there_is_named(meters: Meters):
    address = meters.voltmeter().replace("::22::", "::23::")
    with refused(LinkLost, names=(address,)):
        opened(address)


def test_a_closed_instrument_may_be_closed_again(meters: Meters):
    voltmeter = opened(meters.voltmeter())
    voltmeter.close()
    voltmeter.close()
    assert list(meters.visa.sessions) == [meters.visa.resource_manager.session]


def test_a_setup_is_sent_and_its_error_is_told(meters: Meters):
    with opened(meters.voltmeter("setup=VOLT:DC:NPLC 100")) as voltmeter:
        assert voltmeter.read().unit == "V"
    with refused(InputError) as refusal:
        opened(meters.voltmeter("setup=VOLT:DC:NPLX 100"))
    assert "ERROR" in str(refusal.value)


@pytest.mark.parametrize(
    ("option", "key"),
    [("range=10", "range"), ("termination=nl", "termination"), ("unit=foo", None)],
)
def test_a_malformed_address_is_refused(meters: Meters, option: str, key: str | None):
    with refused(InputError, key=key):
        opened(meters.voltmeter(option))


@pytest.mark.parametrize("backend", ["@nobody", "missing.yaml@sim", f"{__file__}@sim"])
def test_a_library_that_cannot_be_loaded_is_refused(backend: str):
    with refused(InputError, key="backend") as refusal:
        opened(f"visa:GPIB0::22::INSTR?backend={backend}")
    assert "\n" not in str(refusal.value)
    assert "Traceback" not in str(refusal.value)


def test_a_missing_pyvisa_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "pyvisa", None)
    with refused(MissingExtra, names=("visa",)):
        opened("visa:GPIB0::22::INSTR")


def test_a_socket_is_read_by_pyvisa_py_and_opened_again_after_a_missing_reply():
    values = iter(["1.0\n", "", "2.0\n"])

    def answer(line: str) -> str:
        return "A,B,C,D\n" if line == "*IDN?" else next(values)

    with serve(answer) as server:
        place = server.address.removeprefix("tcp://").replace(":", "::")
        with open_instrument(f"visa:TCPIP0::{place}::SOCKET?backend=@py", 0.2) as meter:
            assert meter.read().value == 1.0
            with pytest.raises(LinkLost):
                meter.read()
            assert meter.read().value == 2.0

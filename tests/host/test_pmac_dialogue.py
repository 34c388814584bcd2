"""One question, one answer: also when replies are late, in pieces, damaged, or lost."""

from collections.abc import Callable
from typing import Any

import pytest
from tests.host.conftest import opened_by

from inercal.host.drivers.pmac_codec import CommandRefused
from inercal.host.drivers.pmac_dialogue import PmacDialogue
from inercal.host.drivers.rotary_table import ProtocolError
from inercal.host.link import Link, LinkLost, open_link
from inercal.host.sim.pmac import SimulatedPmac
from inercal.host.sim.server import SimulatorServer

Served = SimulatorServer[SimulatedPmac]


def _simulated() -> Callable[[bytes], bytes]:
    return SimulatedPmac().session().feed


def _keeping(links: list[Link], opener: Callable[[str], Link] = open_link) -> Callable[[str], Link]:
    """Return an opener that keeps what it opens."""

    def opens(address: str) -> Link:
        links.append(opener(address))
        return links[-1]

    return opens


@pytest.mark.parametrize("size", [1, 2, 3, 7, 1399, 1400])
def test_replies_in_pieces_of_any_size_are_the_same(scripted: Any, size: int):
    line = " ".join(["I20..23 #1P I10"] * 60)
    links: list[Link] = []
    opener = _keeping(links, lambda _: scripted(_simulated(), size))
    with opened_by(opener), PmacDialogue("tcp://x:1", 1.0) as dialogue:
        lines = dialogue.ask(line, 360)
        assert lines == ["$78400", "$0", "$0", "$0", "0", "3713707"] * 60
    assert len(links) == 1


def test_a_long_reply_is_asked_for_in_chunks_of_1400(scripted: Any):
    links = []

    def opener(_: str) -> Any:
        links.append(scripted(_simulated()))
        return links[-1]

    with opened_by(opener), PmacDialogue("tcp://x:1", 1.0) as dialogue:
        # 350 times "3713707\r" and ACK are 2801 bytes.
        assert dialogue.ask("I10 " * 350, 350) == ["3713707"] * 350
    assert links[0].written[-2:] == [bytes.fromhex("C0 C5 00 00 00 00 05 78")] * 2


def test_a_reply_that_comes_after_the_timeout_is_never_taken_for_the_next(
    pmac: Served,
):
    with PmacDialogue(pmac.address, 0.3) as dialogue:
        pmac.faults.delay = 1.0
        with pytest.raises(ProtocolError):
            dialogue.ask("#1P", 1)
        pmac.faults.delay = 0.0
        pmac.advance(0.5)
        assert dialogue.ask("I10", 1) == ["3713707"]
        pmac.advance(2.0)  # Now the late one is sent, to where nobody is.
        assert dialogue.ask("I22", 1) == ["$0"]


def test_the_rest_of_a_reply_cut_by_a_timeout_is_never_taken_for_the_next(scripted: Any):
    late: list[bytes] = []

    def opener(_: str) -> Any:
        feed = _simulated()

        def answer(data: bytes) -> bytes:
            reply = feed(data)
            if data.endswith(b"#1P #2P"):
                late.append(reply[3:])
                return reply[:3]
            return reply

        return scripted(answer)

    links: list[Link] = []
    with opened_by(_keeping(links, opener)), PmacDialogue("tcp://x:1", 0.02) as dialogue:
        with pytest.raises(ProtocolError):
            dialogue.ask("#1P #2P", 2)
        assert late
        assert dialogue.ask("I10", 1) == ["3713707"]
    assert len(links) == 2


def test_bytes_that_come_unasked_end_the_connection(scripted: Any):
    links = []

    def opener(_: str) -> Any:
        links.append(scripted(_simulated()))
        return links[-1]

    with opened_by(opener), PmacDialogue("tcp://x:1", 1.0) as dialogue:
        links[0]._waiting = b"1995\r\x06"
        with pytest.raises(ProtocolError):
            dialogue.ask("#1P", 1)
        assert dialogue.ask("I10", 1) == ["3713707"]


def test_another_number_of_lines_is_no_answer(pmac: Served):
    with (
        PmacDialogue(pmac.address) as dialogue,
        pytest.raises(ProtocolError),
    ):
        dialogue.ask("I10", 2)


def test_a_refusal_keeps_the_connection(pmac: Served):
    links: list[Link] = []
    with opened_by(_keeping(links)), PmacDialogue(pmac.address) as dialogue:
        with pytest.raises(CommandRefused) as refusal:
            dialogue.ask("nonsense")
        assert refusal.value.code == 3
        with pytest.raises(CommandRefused) as refusal:
            dialogue.ask("&1 B5R")
        assert refusal.value.code == 15
        assert dialogue.ask("I10", 1) == ["3713707"]
    assert len(links) == 1


@pytest.mark.slow
def test_corrupted_bytes_are_never_a_silent_number(pmac: Served):
    with PmacDialogue(pmac.address, 0.2) as dialogue:
        pmac.faults.corrupt = 7
        told: list[str] = []
        for _ in range(200):
            try:
                told += dialogue.ask("RHX$0", 1)
            except (ProtocolError, CommandRefused, LinkLost):
                continue
        # One bit in a digit makes another digit: no check protects those. Most were told apart.
        assert told.count("0") > 150


def test_a_dropped_connection_is_told_and_the_next_question_is_answered(
    pmac: Served,
):
    links: list[Link] = []
    with opened_by(_keeping(links)), PmacDialogue(pmac.address) as dialogue:
        pmac.faults.drop = 1
        with pytest.raises(LinkLost):
            dialogue.ask("I10", 1)
        assert dialogue.ask("I10", 1) == ["3713707"]
    assert len(links) == 2


def test_a_controller_that_is_gone_is_a_lost_link_and_comes_back():
    simulated = SimulatedPmac()
    with SimulatorServer(simulated) as server:
        dialogue = PmacDialogue(server.address)
    with pytest.raises(LinkLost):
        dialogue.ask("I10", 1)
    with pytest.raises(LinkLost):
        dialogue.ask("I10", 1)
    with SimulatorServer(simulated, port=server.port), dialogue:
        assert dialogue.ask("I10", 1) == ["3713707"]


def test_what_is_no_pmac_is_told(scripted: Any):
    with opened_by(lambda _: scripted(lambda _: b"SSH-2.0\r\n")), pytest.raises(LinkLost):
        PmacDialogue("tcp://x:1", 0.01)

"""Simulators at the end of real connections and in processes of their own, with their faults."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import StringIO

import pytest
from tests.refusals import refused

from inercal.host.drivers.pmac import Pmac, PmacAxis
from inercal.host.link import LinkLost, open_link, read_until
from inercal.host.sim.faults import Faults
from inercal.host.sim.pmac import SimulatedPmac
from inercal.host.sim.server import ManualClock, ScaledClock, SimulatorServer, execute_commands

Served = SimulatorServer[SimulatedPmac]

AXES = (PmacAxis("inner", 3, 3_600_000),)


@contextmanager
def _process(module: str, *options: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    command = [sys.executable, "-m", f"inercal.host.sim.{module}", *options]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout
        yield process, process.stdout.readline().removeprefix("at ").strip()


def _tell(process: subprocess.Popen[str], line: str) -> str:
    assert process.stdin
    assert process.stdout
    process.stdin.write(f"{line}\n")
    process.stdin.flush()
    return process.stdout.readline().strip()


@pytest.mark.slow
def test_a_process_of_its_own_serves_at_told_time_and_ends_with_its_input():
    with _process("pmac", "--port", "0", "--pace", "told") as (process, address):
        with Pmac(address, AXES, timeout=20.0) as table:
            table.enable()
            table.move("inner", 0.5, 1.0, 1.0)
            assert _tell(process, "advance 5") == "ok"
            assert table.read().axes[0].angle == pytest.approx(0.5, abs=1e-5)
            assert _tell(process, "fault amplifier 3") == "ok"
            assert _tell(process, "advance 5.1") == "ok"
            assert "amplifier fault" in table.read().axes[0].faults
            assert _tell(process, "fault melted 3").startswith("no: ")
        assert process.stdin
        process.stdin.close()
        assert process.wait(20) == 0


@pytest.mark.slow
def test_a_process_that_is_killed_is_a_lost_link():
    with (
        _process("pmac") as (process, address),
        Pmac(address, AXES, timeout=20.0) as table,
    ):
        assert _tell(process, "die") == ""
        assert process.wait(20) == 9
        with pytest.raises(LinkLost):
            table.read()


def test_the_wall_clock_paces_where_it_is_asked_to():
    with (
        SimulatorServer(SimulatedPmac(), ScaledClock(1000.0)) as server,
        Pmac(server.address, AXES, timeout=5.0) as table,
    ):
        first = table.read().time
        while table.read().time < first + 10.0:
            pass  # 10 ms of the wall's time.
        assert server.device.time > 10.0


def test_the_same_commands_at_the_same_bench_times_give_the_same_numbers_at_any_pace():
    results = []
    for steps in (1, 50):
        with (
            SimulatorServer(SimulatedPmac()) as server,
            Pmac(server.address, AXES, timeout=5.0) as table,
        ):
            table.enable()
            table.move("inner", 1.0, 0.7, 0.9)
            for k in range(steps):
                server.advance((k + 1) * 2.0 / steps)
            results.append(table.read())
    assert results[0].axes == results[1].axes


def test_delays_are_bench_time(pmac: Served):
    pmac.faults.delay = 0.5
    with open_link(pmac.address) as link:
        link.write(bytes.fromhex("40 B3 00 00 00 00 00 00"))
        assert link.read(10, 0.05) == b""
        pmac.advance(0.6)
        assert link.read(10, 5.0) == b"@"


def test_fragments_come_one_by_one_and_whole():
    pieces, ends = Faults(fragment=3).apply_faults(b"12345678")
    assert (pieces, ends) == ([b"123", b"456", b"78"], False)


def test_corruption_turns_one_bit_of_every_nth_reply():
    faults = Faults(corrupt=3)
    sent = [b"".join(faults.apply_faults(b"\0" * 8)[0]) for _ in range(9)]
    assert [sum(byte.bit_count() for byte in reply) for reply in sent] == [0, 0, 1] * 3


def test_drop_ends_the_nth_reply_before_it_is_whole(pmac: Served):
    pmac.faults.drop = 2
    with open_link(pmac.address) as link:
        link.write(bytes.fromhex("40 B3 00 00 00 00 00 00"))
        assert link.read(10, 5.0) == b"@"
        link.write(bytes.fromhex("40 BF 00 00 00 00 00 03") + b"I10")
        came: list[bytes] = []
        with pytest.raises(LinkLost):
            read_until(link, lambda data: came.append(data) is not None, 5.0)
        assert b"".join(came) == b"3713"


@pytest.mark.parametrize("words", ["", "fragment", "fragment x", "delay -1", "delay nan", "burn"])
def test_words_that_are_no_fault_are_refused_with_those_that_are(words: str):
    with refused(key="fault", names=(words,)):
        Faults().set_fault(words)


def test_lines_told_are_answered_each(pmac: Served):
    answers = StringIO()
    execute_commands(
        pmac, StringIO("advance 1.5\nadvance x\nfragment 2\nfault jammed 4\n"), answers
    )
    said = answers.getvalue().splitlines()
    assert [line[:3] for line in said] == ["ok", "no:", "ok", "no:"]
    assert pmac.faults.fragment == 2
    assert isinstance(pmac.pace, ManualClock)
    assert pmac.pace.now == 1.5

"""What a run tells: never waiting, news always, pictures as far as somebody takes them."""

import json
import os
from itertools import pairwise
from time import monotonic

import pytest

from inercal.host.web import worker_process
from inercal.host.web.message_history import MessageHistory, coarse_to_fine
from inercal.host.web.worker_process import Publisher

PATIENCE = 20.0  # s


def test_of_what_waits_the_oldest_pictures_give_way_and_the_order_stays(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(worker_process, "MAX_DROPPABLE", 2)
    out, into = os.pipe()
    with Publisher(into) as publisher:
        publisher.publish("event", n=-1, words="x" * 200_000)  # more than the pipe takes
        for k in range(10):
            publisher.publish("state" if k % 3 else "event", n=k)
        data = b""
        while data.count(b"\n") < 7:
            data += os.read(out, 1 << 16)
    messages = [json.loads(line.partition(b" ")[2]) for line in data.splitlines()]
    assert [one["n"] for one in messages] == [-1, 0, 3, 6, 7, 8, 9]
    for end in (out, into):
        os.close(end)


def read_all(descriptor: int) -> list[dict[str, object]]:
    data = b""
    while piece := os.read(descriptor, 1 << 16):
        data += piece
    lines = data.decode().splitlines()
    messages = [json.loads(line.partition(" ")[2]) for line in lines]
    assert [line.partition(" ")[0] for line in lines] == [one["kind"] for one in messages]
    return messages


def test_what_cannot_be_told_is_left_out_with_a_word_and_what_follows_is_told(
    capsys: pytest.CaptureFixture[str],
):
    out, into = os.pipe()
    with Publisher(into) as publisher:
        publisher.publish("state", time=float("nan"))
        publisher.publish("event", words="\ud800")
        publisher.publish("event", words=object())
        publisher.publish("event", words="after")
    os.close(into)
    assert read_all(out) == [{"kind": "event", "words": "after"}]
    os.close(out)
    said = capsys.readouterr().err
    assert said.count("could not be sent") == 2  # once of each kind
    assert "'state'" in said
    assert "'event'" in said


def test_a_reader_that_takes_nothing_keeps_nobody_waiting_and_misses_no_event():
    out, into = os.pipe()
    publisher = Publisher(into)
    begun = monotonic()
    for k in range(2000):
        publisher.publish("samples", y="x" * 1000, n=k)
        if k % 100 == 0:
            publisher.publish("event", words=f"{k}")
    publisher.close(patience=0.0)
    assert monotonic() - begun < 5.0
    messages: list[dict[str, object]] = []
    # What is still to be written is, as soon as somebody reads.
    while sum(one["kind"] == "event" for one in messages) < 20:
        line = b""
        while not line.endswith(b"\n"):
            line += os.read(out, 1)
        messages.append(json.loads(line.partition(b" ")[2]))
    assert [m["words"] for m in messages if m["kind"] == "event"] == [
        f"{k}" for k in range(0, 2000, 100)
    ]
    assert len(messages) < 300
    os.close(out)
    publisher.close(PATIENCE)
    os.close(into)


def test_where_nobody_reads_any_more_nothing_is_said():
    out, into = os.pipe()
    os.close(out)
    with Publisher(into) as publisher:
        for k in range(1000):
            publisher.publish("event", words=f"{k}")
    publisher.publish("event", words="too late")
    os.close(into)


def test_what_is_told_last_is_written_before_the_end():
    out, into = os.pipe()
    with Publisher(into) as publisher:
        publisher.publish("state", time=1.0, table=None)
        publisher.publish("done", words="µ-tests")
    os.close(into)
    assert read_all(out) == [
        {"kind": "state", "time": 1.0, "table": None},
        {"kind": "done", "words": "µ-tests"},
    ]
    os.close(out)


def event(k: int, level: str = "info") -> tuple[str, str]:
    return "event", json.dumps({"kind": "event", "n": k, "level": level})


def told(*messages: tuple[str, str]) -> tuple[list[str], list[str]]:
    """Return what somebody who comes late is told of how the run stands, and of its past."""
    made = MessageHistory()
    for kind, text in messages:
        made.add_message(kind, text)
    return [text for _, text in made.present()], list(made.past())


def test_a_latecomer_sees_the_phase_before_the_state_or_after_it_as_it_came():
    def present(*messages: tuple[str, str]) -> list[str]:
        return told(*messages)[0]

    assert present(("plan", "P"), ("phase", "starting")) == ["P", "starting"]
    assert present(("plan", "P"), ("phase", "a"), ("state", "S")) == ["P", "a", "S"]
    assert present(("plan", "P"), ("state", "S"), ("phase", "finishing"), ("done", "D")) == [
        "P", "S", "finishing", "D",
    ]  # fmt: skip


def test_a_latecomer_is_told_the_state_and_alarms_before_anything_of_the_past():
    present, past = told(
        ("plan", "P"), ("samples", "s"), event(1), event(2, "alarm"), ("estimates", "E1"),
        ("estimates", "E2"), ("state", "S"), event(3, "warning"),
    )  # fmt: skip
    assert present == ["P", "S", event(2, "alarm")[1], "E2", "s"]
    assert [one["n"] for one in json.loads(past[0])["events"]] == [1, 3]
    assert past[1:] == ["E1", "E2"]


def test_a_latecomer_at_a_manual_session_is_told_the_trend_of_its_last_minute():
    made = MessageHistory(keeps_trend=True)
    made.add_message("state", json.dumps({"time": 0.0, "table": None, "manual": []}))
    for k in range(1, 1001):
        table, manual = {"axes": [{"angle": k}, {"angle": -k}]}, [{"set": 0.5}, {"set": None}]
        told = {"time": k / 10, "table": table, "manual": manual}
        made.add_message("state", json.dumps(told))
    pieces = [json.loads(text) for text in made.past()]
    assert {one["kind"] for one in pieces} == {"trend"}
    points = [point for one in reversed(pieces) for point in one["points"]]
    assert points == [[k / 10, [k, -k], [0.5, None]] for k in range(401, 1001)]


@pytest.mark.parametrize("count", [1, 599, 600, 601, 5000, 100_000])
def test_estimates_are_thinned_evenly_and_the_last_is_told_first(count: int):
    present, past = told(*(("estimates", str(k)) for k in range(count)))
    assert present == [str(count - 1)]
    numbers = sorted(int(text) for text in past)
    assert len(numbers) <= 600
    assert len(numbers) >= min(count, 300)
    assert numbers[0] == 0
    steps = {b - a for a, b in pairwise(numbers)}
    assert len(steps) <= 1


@pytest.mark.parametrize("count", [0, 1, 2, 3, 17, 600])
def test_the_past_is_told_coarse_to_fine_each_of_it_once(count: int):
    order = list(coarse_to_fine(count))
    assert sorted(order) == list(range(count))
    for k in range(2, count):
        gaps = [b - a for a, b in pairwise(sorted(order[: k + 1]))]
        assert max(gaps) <= 4 * count / k


def test_events_and_samples_of_a_long_run_are_bounded():
    present, past = told(*(event(k) for k in range(2000)), *(("samples", "s") for _ in range(999)))
    assert present.count("s") == 100
    chunks = [json.loads(text)["events"] for text in past]
    numbers = [one["n"] for chunk in reversed(chunks) for one in chunk]
    assert numbers == list(range(1500, 2000))
    assert max(len(chunk) for chunk in chunks) <= 20

"""A run's process that moves nothing: it tells what a run tells, and does what it is told.

It speaks as `inercal.host.web.worker` does; a line `fall` has it end without a word, `end` well.
"""

import json
import os
import select
import signal
import sys

STEPS = 3


def tell(kind: str, **content: object) -> None:
    line = json.dumps({"kind": kind, **content})
    os.write(1, f"{kind} {line}\n".encode())


def main() -> None:
    order = json.loads(sys.stdin.buffer.readline())
    run = os.path.basename(order["folder"])
    stopped, poke = os.pipe()
    os.set_blocking(poke, False)
    signal.signal(signal.SIGINT, lambda *_: None)
    signal.set_wakeup_fd(poke)
    tell(
        "plan", run=run, sensor=order["sensor"], by=order["requested_by"], speed=order["options"][0]
    )
    tell("phase", run=run, words="scripted")
    for k in range(STEPS):
        at = "2026-11-22T12:00:00.000+00:00"
        tell("event", n=k + 1, at=at, time=float(k), level="info", words=f"{k}")
    paused, n, heard = "", 0, b""
    state, words = "interrupted", ""
    while not words:
        ready, _, _ = select.select([0, stopped], [], [], 0.02)
        if stopped in ready:
            words = "stopped by the operator"
        elif 0 in ready:
            data = os.read(0, 4096)
            if not data:
                # Nobody commands any more: the run goes on to its end.
                state, words = "done", "nobody commands"
            heard += data
            *lines, heard = heard.split(b"\n")
            for line in lines:
                match line.decode():
                    case "pause":
                        paused = "paused by the operator"
                    case "go on":
                        paused = ""
                    case "abort":
                        words = "aborted"
                    case "end":
                        state, words = "done", "all is well"
                    case "fall":
                        os._exit(7)
                    case other:
                        tell(
                            "event",
                            n=STEPS + 1,
                            at="",
                            time=None,
                            level="alarm",
                            words=f"what is {other}?",
                        )
        n += 1
        tell("state", time=n * 0.02, paused=paused)
        for kind in ("coarse", "samples"):
            tell(kind, t=[n * 0.02], y=[[0.0]] * 6, every=1)
        if n % 10 == 0:
            tell("estimates", time=n * 0.02, values=[0.0], u2=[1.0], nis={})
    links = dict.fromkeys(("report", "calibration", "history", "verdict"))
    tell("done", run=run, state=state, words=words, **links)


if __name__ == "__main__":
    main()

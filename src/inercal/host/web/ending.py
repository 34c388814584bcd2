"""How a run ends: what is made of it, the register, and what the page is told."""

from typing import Any

from inercal.errors import InercalError
from inercal.host.finish import finish
from inercal.host.folder import Folder
from inercal.host.journal import Journal
from inercal.host.live import Live
from inercal.host.run import BenchRun
from inercal.host.web.order import Order
from inercal.host.web.teller import Teller
from inercal.pipeline.judgement import judge

Told = dict[str, Any]


def told(order: Order, state: str, words: str = "", **more: object) -> Told:
    """Return what is told of an end: "done", "carried out" (no calibration) or "interrupted"."""
    links = dict.fromkeys(("report", "calibration", "history", "verdict"))
    return {"run": order.name, "state": state, "words": words, **links, **more}


def interrupted(
    order: Order, made: Folder, journal: Journal, teller: Teller, run: BenchRun
) -> Told:
    """Tell of a run that may go on later; it is entered in the register as it is."""
    history = _entered(order, made, journal)
    teller.events()
    return told(order, "interrupted", run.trouble or "interrupted", history=history)


def finished(
    order: Order, made: Folder, journal: Journal, teller: Teller, live: Live | None
) -> Told:
    """Make recording, calibration and report, and enter them."""
    try:
        outcome = finish(made, journal, live).outcome
    except InercalError as error:
        journal.event("alarm", str(error))
        history = _entered(order, made, journal)
        teller.events()
        return told(order, "carried out", str(error), history=history)
    history = _entered(order, made, journal)
    teller.events()
    judgement = judge(outcome)
    verdict = {"level": judgement.tone, "words": judgement.word}
    links = {what: f"/runs/{order.name}/{what}" for what in ("report", "calibration")}
    words = " ".join(judgement.lines[:1])
    return told(order, "done", words, history=history, verdict=verdict, **links)


def _entered(order: Order, made: Folder, journal: Journal) -> str | None:
    """Put the run into the register; return where its sensor's history is, if it has one.

    What fails here the server does when it is started next: no run is lost.
    """
    from inercal.host.entering import enter
    from inercal.store import Register

    try:
        with Register(order.register, order.by or None) as register:
            enter(register, made.path)
            sensor = register.sensor(made.run.sensor.name)
    except InercalError as error:
        journal.event("warning", f"not yet entered in the register: {error}")
        return None
    return f"/history/{sensor.id}" if sensor.calibrations else None

"""How a run ends: what is made of it, the register, and what the page is told."""

from urllib.parse import quote

from inercal.errors import InercalError
from inercal.host.finish import finish
from inercal.host.folder import Folder
from inercal.host.journal import Journal
from inercal.host.live import Live
from inercal.host.registration import RegisterSync
from inercal.host.web.order import EndMessage, RunRequest, end_message
from inercal.store import Register


class RunFinalizer:
    """The end of one run.

    A register that cannot be reached is said and ends nothing: the server enters all its runs when
    it is started next, so that none is lost.

    Parameters
    ----------
    order : RunRequest
    made : Folder
    journal : Journal
    """

    def __init__(self, order: RunRequest, made: Folder, journal: Journal):
        self._order, self._made, self._journal = order, made, journal
        self._register: Register | None = None
        try:
            self._register = Register(order.register, order.by or None)
        except InercalError as error:
            journal.event("warning", f"the run is not in the register: {error}")
        self.keeper = RegisterSync(self._register, made.path)

    def interrupted(self, words: str) -> EndMessage:
        """Return what is told of a run that may go on later."""
        return end_message(
            self._order, "interrupted", words or "interrupted", history=self._entered()
        )

    def finished(self, live: Live | None) -> EndMessage:
        """Make recording, calibration and report; return what is told of them."""
        sensor = self._made.run.sensor.name
        try:
            outcome, _ = finish(
                self._made, self._journal, live, lambda: self.keeper.history(sensor)
            )
        except InercalError as error:
            self._journal.event("alarm", str(error))
            return end_message(self._order, "carried out", str(error), history=self._entered())
        name = quote(self._order.name, safe="")
        links = {what: f"/runs/{name}/{what}" for what in ("report", "calibration")}
        verdict = {"level": outcome.verdict.tone, "words": outcome.verdict.word}
        words = outcome.verdict.lines[0]
        history = self._entered()
        return end_message(self._order, "done", words, history=history, verdict=verdict, **links)

    def _entered(self) -> str | None:
        """Enter the run as it is; return where its sensor's history is, if it has one."""
        self.keeper.enter()
        if self.keeper.trouble:
            self._journal.event("warning", self.keeper.trouble)
        if self.keeper.trouble or self._register is None:
            return None
        try:
            sensor = self._register.sensor(self._made.run.sensor.name)
        except InercalError:
            return None
        return f"/history/{sensor.id}" if sensor.calibrations else None

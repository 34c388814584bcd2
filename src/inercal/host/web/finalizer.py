"""How a run ends: what is made of it, the register, and what the page is told."""

from urllib.parse import quote

from inercal.errors import InercalError
from inercal.host.journal import Journal
from inercal.host.live_estimator import LiveEstimator
from inercal.host.registration import RegisterSync
from inercal.host.run_completion import finish_run
from inercal.host.run_folder import RunFolder
from inercal.host.web.page_messages import final_estimates
from inercal.host.web.run_request import EndMessage, RunRequest, end_message
from inercal.store import Register


class RunFinalizer:
    """The end of one run.

    A register that cannot be reached is said and ends nothing: the server enters all its runs when
    it is started next, so that none is lost.

    Parameters
    ----------
    order : RunRequest
    made : RunFolder
    journal : Journal
    """

    def __init__(self, order: RunRequest, made: RunFolder, journal: Journal):
        self._order, self._folder, self._journal = order, made, journal
        self._register: Register | None = None
        try:
            self._register = Register(order.register, order.requested_by or None)
        except InercalError as error:
            journal.record_event("warning", f"the run is not in the register: {error}")
        self.register_sync = RegisterSync(self._register, made.path)

    def interruption_message(self, words: str) -> EndMessage:
        """Return what is told of a run that may go on later."""
        return end_message(
            self._order, "interrupted", words or "interrupted", history=self._enter_in_register()
        )

    def complete_run(self, live: LiveEstimator | None) -> EndMessage:
        """Make recording, calibration and report; return what is told of them."""
        sensor = self._folder.run.sensor.name
        try:
            outcome, _ = finish_run(
                self._folder, self._journal, live, lambda: self.register_sync.history(sensor)
            )
        except InercalError as error:
            self._journal.record_event("alarm", str(error))
            return end_message(
                self._order, "carried out", str(error), history=self._enter_in_register()
            )
        name = quote(self._order.name, safe="")
        links = {what: f"/runs/{name}/{what}" for what in ("report", "calibration")}
        verdict = {
            "level": outcome.verdict.tone,
            "words": outcome.verdict.word,
            "reasons": list(outcome.verdict.reasons),
        }
        words = outcome.verdict.lines[0]
        return end_message(
            self._order,
            "done",
            words,
            history=self._enter_in_register(),
            verdict=verdict,
            final=final_estimates(outcome.calibration),
            **links,
        )

    def _enter_in_register(self) -> str | None:
        """Enter the run as it is; return where its sensor's history is, if it has one."""
        self.register_sync.update()
        if self.register_sync.trouble:
            self._journal.record_event("warning", self.register_sync.trouble)
        if self.register_sync.trouble or self._register is None:
            return None
        try:
            sensor = self._register.sensor(self._folder.run.sensor.name)
        except InercalError:
            return None
        return f"/history/{sensor.id}" if sensor.calibrations else None

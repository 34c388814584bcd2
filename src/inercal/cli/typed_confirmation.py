"""The line that an operator types at a terminal to confirm a mounting, beside the keys of a run."""

from typing import TYPE_CHECKING

from inercal.cli.mounting_answers import WORD, mismatch_text, parse_answer, report_line

if TYPE_CHECKING:
    from inercal.host.bench_run import BenchRun
    from inercal.host.spin_sequencer import MountingRequest

_ENTER, _ERASE, _MAX_LINE = "\r\n", "\b\x7f", 120
_ESCAPE, _BEGINNING = "\x1b", f"{WORD} "


class TypedConfirmation:
    """Takes the characters of a line `mounted NAME` or `mounted NAME OPERATOR`.

    It counts for the request that was published when its first character came.

    Attributes
    ----------
    text : str
        As typed so far.
    """

    def __init__(self):
        self.text = ""
        self._request: MountingRequest | None = None

    def take(self, character: str, run: "BenchRun", operator: str) -> bool:
        """Take a character; False where it is none of a line, as that of another key.

        Parameters
        ----------
        character : str
        run : BenchRun
        operator : str
            Who confirms where the line names nobody.
        """
        begun = self.text + character
        if character not in _ENTER + _ERASE and not (
            begun.startswith(_BEGINNING) or _BEGINNING.startswith(begun)
        ):
            self.text = ""  # no such line: its characters, as of a key hit twice, keep no key back
        if not self.text:
            if character != _BEGINNING[0]:
                return False
            self._request = run.mounting_request
        if character in _ENTER:
            line, self.text = self.text, ""
            self._confirm(line, run, operator)
        elif character == _ESCAPE:
            self.text = ""
        elif character in _ERASE:
            self.text = self.text[:-1]
        elif character.isprintable() and len(self.text) < _MAX_LINE:
            self.text += character
        return True

    def _confirm(self, line: str, run: "BenchRun", operator: str) -> None:
        request = self._request
        if request is None or run.mounting_request != request:
            report_line(
                f"{line!r} was begun before the mounting was requested, and confirms nothing"
            )
            return
        answer = parse_answer(line)
        if answer is None or answer.mounting != request.mounting:
            report_line(mismatch_text(line, request))
            return
        run.confirm_mounting(request.number, answer.mounting, answer.operator or operator)

"""`inercal apply --stream`: correct samples while they arrive."""

import signal
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType

from inercal.calibration import Calibration
from inercal.cli.apply_command import assumed_zero_texts, unreliable_text
from inercal.cli.console import report_line
from inercal.host.correction import LiveCorrection, open_correction
from inercal.runfile import Run


def apply_stream(
    calibration: Calibration, run: Run, source: str, to: str | None, form: str, *, extrapolate: bool
) -> None:
    """Correct samples until the source ends or Ctrl-C is pressed, and print a summary."""
    correction = open_correction(
        calibration, run, source, to=to, form=form, extrapolate=extrapolate, tell=report_line
    )
    for text in (*unreliable_text(calibration), *assumed_zero_texts(calibration)):
        report_line(text)
    with _interrupts_stop(correction):
        report_line(str(correction.run()))


@contextmanager
def _interrupts_stop(correction: LiveCorrection) -> Generator[None]:
    """Let the first Ctrl-C stop a correction, and a second one the program."""

    def stop(number: int, frame: FrameType | None) -> None:
        correction.stop()
        signal.signal(number, before)

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)

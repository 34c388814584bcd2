"""Corrects the samples of a sensor while they arrive, in one loop without threads.

`open_correction` connects a source, a parser, a corrector and an output, and `LiveCorrection` runs
them. Each of them can also be used without the others.
"""

import select
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from inercal.basics.closeable import on_failure
from inercal.basics.errors import InercalError, InputError
from inercal.basics.units import format_count, format_duration
from inercal.calibration import Calibration
from inercal.host.addresses import layout_of_address, link_of_address
from inercal.host.correction import outputs
from inercal.host.correction.sources import Source
from inercal.host.correction.text_rows import ArrivedPackets, ArrivedRows, TextRows, layout_of_file
from inercal.host.link import LinkLost
from inercal.pipeline.correction import sensor_findings
from inercal.pipeline.live_correction import LiveCorrector, SampleFlag
from inercal.runfile import Run

_PAUSE = 0.0025  # s between two looks at a live source, which saves waking up for each sample
_MUCH = 2048  # bytes; if so many arrive at once, there is no pause, so that no buffer overflows
_IDLE = 0.1  # s after which the loop notices `stop` if nothing arrives
_FIRST_RETRY, _LONGEST_RETRY = 0.1, 5.0  # s between attempts to open a lost source
_LAST_WAIT = 1.0  # s that a live source waits for its reader at the end


@dataclass
class LiveSummary:
    """What a live correction did.

    Parameters
    ----------
    samples : int
        Number of corrected samples.
    flagged : int
        Number of samples with a flag.
    malformed : int
        Number of lines or packets that could not be read.
    missing : int
        Number of packets that never arrived, according to the counter or clock of the device.
    lost : int
        Number of samples that slow readers lost.
    reconnections : int
        Number of times that a lost source was opened again.
    seconds : float
        Duration, s.
    """

    samples: int = 0
    flagged: int = 0
    malformed: int = 0
    missing: int = 0
    lost: int = 0
    reconnections: int = 0
    seconds: float = 0.0

    def __str__(self) -> str:
        return (
            f"{format_count(self.samples, 'sample')}, {self.flagged} flagged, {self.malformed} "
            f"malformed, {self.missing} missing, {self.lost} lost, "
            f"{format_count(self.reconnections, 'reconnection')} in {format_duration(self.seconds)}"
        )


class LiveCorrection:
    """Corrects samples from a source and sends them to an output until the source ends.

    Parameters
    ----------
    corrector : LiveCorrector
    source : Source
        Source, which is opened here and closed at the end of `run`.
    parser : TextRows or ArrivedPackets
    output : Output
        Output, which is closed at the end of `run`.
    tell : callable, optional
        Function that receives messages about a lost source and a slow reader.

    Raises
    ------
    InercalError
        The source cannot be opened.
    """

    def __init__(
        self,
        corrector: LiveCorrector,
        source: Source,
        parser: TextRows | ArrivedPackets,
        output: outputs.Output,
        tell: Callable[[str], None] = lambda _: None,
    ):
        self.summary = LiveSummary()
        self._corrector, self._source, self._parser = corrector, source, parser
        self._output, self._tell = output, tell
        self._retry, self._next_attempt = _FIRST_RETRY, 0.0
        self._stopped = self._ended = self._lost = self._pausing = self._told_loss = False
        self._listener = output.listener if isinstance(output, outputs.TcpOutput) else None
        with on_failure(output.close):
            source.open()
        parser.restart(mid_stream=source.mid_stream)

    def stop(self) -> None:
        """End the loop soon; a signal handler or another thread may call this."""
        self._stopped = True

    def run(self) -> LiveSummary:
        """Correct samples until the source ends, `stop` is called, or the only reader is gone.

        Raises
        ------
        InercalError
            The source does not have the columns or any sample, or the output cannot be written.
        """
        start, summary = monotonic(), self.summary
        with self._source, self._output, suppress(outputs.OutputClosed):
            while not (self._stopped or self._ended):
                self._turn()
            self._finish()
        summary.malformed, summary.missing = self._parser.malformed, self._parser.missing
        summary.lost, summary.seconds = self._output.lost, monotonic() - start
        return summary

    def _turn(self) -> None:
        """Wait for the next event and handle it."""
        output, source, wait = self._output, self._source, _IDLE
        if self._lost and (wait := self._next_attempt - monotonic()) <= 0:
            self._try_to_reopen()
            return
        incoming: list[Any] = [] if self._listener is None else [self._listener]
        if self._pausing:
            wait = _PAUSE  # the source is read after the pause, whether bytes have arrived or not
        elif not (self._lost or self._must_wait()):
            incoming.append(source)
        outgoing = [reader for reader in output.readers if not reader.is_idle]
        ready, writable, _ = select.select(incoming, outgoing, [], min(wait, _IDLE))
        if isinstance(output, outputs.TcpOutput) and self._listener in ready:
            output.accept()
        if writable:
            output.flush()
        if self._pausing or source in ready:
            self._take(ready=source in ready)

    def _must_wait(self) -> bool:
        """Return whether a source that can wait must do so for its readers."""
        readers = self._output.readers
        busy = any(reader.waiting >= outputs.MOST_WAITING // 2 for reader in readers)
        return not self._source.live and (busy or not readers)

    def _take(self, *, ready: bool) -> None:
        """Correct the samples that have arrived."""
        try:
            data = self._source.take(ready=ready)
        except LinkLost as error:
            self._tell(f"lost the source: {error}; trying to open it again")
            self._source.close()
            self._lost, self._pausing, self._retry = True, False, _FIRST_RETRY
            self._next_attempt = monotonic() + self._retry
            return
        self._ended = data is None
        self._pausing = self._source.live and 0 < len(data or b"") < _MUCH
        if data:
            self._send(self._parser.feed(data))

    def _send(self, rows: ArrivedRows | None) -> None:
        if rows is None or not rows.time.size:
            return
        block = self._corrector.correct(rows.time, rows.readings, rows.kelvin)
        if rows.saturated is not None:
            block.flags[rows.saturated] |= SampleFlag.SATURATED
        self.summary.samples += block.time.size
        self.summary.flagged += int(np.count_nonzero(block.flags))
        self._output.put(block)
        self._output.flush()
        if self._output.lost and not self._told_loss:
            self._told_loss = True
            self._tell("the reader is too slow, so the oldest samples are lost")

    def _try_to_reopen(self) -> None:
        try:
            self._source.open()
        except InercalError:
            self._retry = min(2 * self._retry, _LONGEST_RETRY)
            self._next_attempt = monotonic() + self._retry
            return
        self._lost = False
        self.summary.reconnections += 1
        self._parser.restart(mid_stream=self._source.mid_stream)
        self._tell(f"opened {self._source.address} again")

    def _finish(self) -> None:
        """Send the last sample, and what still waits for the readers."""
        if self._ended:
            self._send(self._parser.finish())
            if not self.summary.samples:
                raise InputError(f"{self._source.address}: no sample of [data] could be read")
        end = monotonic() + _LAST_WAIT
        while waiting := [reader for reader in self._output.readers if not reader.is_idle]:
            if (self._source.live or self._stopped) and monotonic() >= end:
                for reader in waiting:
                    reader.lost += reader.waiting
                return
            select.select([], waiting, [], _IDLE)
            self._output.flush()


def open_correction(
    calibration: Calibration,
    run: Run | str | Path,
    source: str,
    *,
    to: str | None = None,
    form: str = "csv",
    extrapolate: bool = False,
    tell: Callable[[str], None] = lambda _: None,
) -> LiveCorrection:
    """Open a source and an output, and return the correction between them.

    Parameters
    ----------
    calibration : Calibration
    run : Run or path
        Run file with the readout of the sensor, and the columns of the source in [data].
    source : str
        Address of the source, see `Source`. With `?preset=NAME` or `?layout=FILE` it sends packets,
        otherwise lines of text.
    to : str, optional
        `tcp://HOST:PORT` to which readers connect, or `udp://HOST:PORT` to which datagrams are
        sent; by default standard output.
    form : str
        One of `FORMATS`.
    extrapolate : bool
        See `LiveCorrector`.
    tell : callable, optional
        See `LiveCorrection`.

    Raises
    ------
    InercalError
        An address is malformed or cannot be opened, or the run file does not fit the calibration or
        the source.
    """
    if form not in outputs.FORMATS:
        raise InputError(
            f"no format {form!r}; possible: {', '.join(outputs.FORMATS)}", key="--format"
        )
    corrector, opened = LiveCorrector(calibration, run, extrapolate=extrapolate), Source(source)
    run = corrector.run
    for finding in sensor_findings(calibration, run):
        tell(f"warning: {finding.message}")
    if link_of_address(source) != source:
        parser = ArrivedPackets(run, layout_of_address(source))
    else:
        layout = None if opened.file is None else layout_of_file(run, opened.file)
        parser = TextRows(run, opened.address, layout, tell)
    output = outputs.open_output(to, outputs.FORMATS[form](corrector.names))
    return LiveCorrection(corrector, opened, parser, output, tell)

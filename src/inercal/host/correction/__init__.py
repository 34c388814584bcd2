"""Corrects the samples of a sensor while they arrive, in one loop without threads.

`open_correction` connects a source, a parser, a corrector and an output, and `LiveCorrection` runs
them. Each of them can also be used without the others.
"""

import select
from collections.abc import Callable
from contextlib import ExitStack
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
from inercal.host.correction.formats import FORMATS
from inercal.host.correction.outputs import (
    DescriptorOutput,
    Output,
    OutputClosed,
    TcpOutput,
    UdpOutput,
)
from inercal.host.correction.packet_rows import PacketRows
from inercal.host.correction.rows import Parser, Rows
from inercal.host.correction.sources import LOCAL, OpenSource, Source, find_source
from inercal.host.correction.text_rows import TextRows, layout_of_file
from inercal.host.link import LinkLost
from inercal.pipeline.live_correction import CorrectedBlock, LiveCorrector, SampleFlag
from inercal.runfile import Run, read

_PAUSE = 0.0028  # s between two looks at a live source, which saves waking up for each sample
_MUCH = 2048  # bytes; if so many arrive at once, there is no pause, so that no buffer overflows
_IDLE = 0.1  # s after which the loop notices `stop` if nothing arrives
_FIRST_RETRY, _LONGEST_RETRY = 0.1, 5.0  # s between attempts to open a lost source
_LAST_WAIT = 1.0  # s that a live source waits for its reader at the end
_MOST_WAITING = 10_000  # samples; a source that can wait does so while its reader has more


@dataclass
class Summary:
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
        parts = [
            format_count(self.samples, "sample"),
            f"{self.flagged} flagged",
            f"{self.malformed} malformed",
            f"{self.missing} missing",
            f"{self.lost} lost",
            format_count(self.reconnections, "reconnection"),
        ]
        return f"{', '.join(parts)} in {format_duration(self.seconds)}"


class LiveCorrection:
    """Corrects samples from a source and sends them to an output until the source ends.

    Parameters
    ----------
    corrector : LiveCorrector
    source : Source
    parser : Parser
        `TextRows` or `PacketRows`.
    output : Output
        `DescriptorOutput`, `TcpOutput` or `UdpOutput`; it is closed at the end.
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
        parser: Parser,
        output: Output,
        tell: Callable[[str], None] = lambda _: None,
    ):
        self.summary = Summary()
        self._corrector, self._parser, self._output, self._tell = corrector, parser, output, tell
        self._source = source
        self._open: OpenSource | None = source.open()
        parser.restart(mid_stream=source.mid_stream)
        self._retry, self._next_attempt = _FIRST_RETRY, 0.0
        self._stopped = self._ended = self._pausing = self._told_loss = False

    def stop(self) -> None:
        """End the loop soon; a signal handler or another thread may call this."""
        self._stopped = True

    def run(self) -> Summary:
        """Correct samples until the source ends, `stop` is called, or the only reader is gone.

        Raises
        ------
        InercalError
            The source does not have the columns, or the output cannot be written.
        """
        start = monotonic()
        with ExitStack() as closing:
            closing.callback(self._close)
            try:
                while not (self._stopped or self._ended):
                    self._turn()
                self._finish()
            except OutputClosed:
                pass
        summary = self.summary
        summary.malformed, summary.missing = self._parser.malformed, self._parser.missing
        summary.lost, summary.seconds = self._output.lost, monotonic() - start
        return summary

    def _close(self) -> None:
        if self._open is not None:
            self._open.close()
        self._output.close()

    def _turn(self) -> None:
        """Wait for the next event and handle it."""
        output, source = self._output, self._open
        if source is None and (wait := self._next_attempt - monotonic()) <= 0:
            self._try_to_reopen()
            return
        outgoing = [reader for reader in output.readers if not reader.is_idle]
        incoming: list[Any] = [*output.listeners]
        if self._pausing:
            wait = _PAUSE  # the source is read after the pause, whether bytes have arrived or not
        elif source is not None:
            wait = _IDLE
            if not self._must_wait():
                incoming.append(source)
        ready, writable, _ = select.select(incoming, outgoing, [], min(wait, _IDLE))
        if ready and output.listeners:
            output.accept()
        if writable:
            output.flush()
        if source is not None and (self._pausing or source in ready):
            self._take(source, ready=source in ready)

    def _must_wait(self) -> bool:
        """Return whether a source that can wait must do so for its readers."""
        readers = self._output.readers
        if self._source.live:
            return False
        if self._output.listeners and not readers:
            return True
        return any(reader.waiting >= _MOST_WAITING // 2 for reader in readers)

    def _take(self, source: OpenSource, *, ready: bool) -> None:
        """Correct the samples that have arrived."""
        try:
            data = source.take(ready=ready)
        except LinkLost as error:
            self._tell(f"lost the source: {error}; trying to open it again")
            source.close()
            self._open, self._pausing, self._retry = None, False, _FIRST_RETRY
            self._next_attempt = monotonic() + self._retry
            return
        if data is None:
            self._ended = True
            return
        self._pausing = self._source.live and 0 < len(data) < _MUCH
        if data:
            self._send(self._parser.feed(data))

    def _send(self, rows: Rows | None) -> None:
        if rows is None or not rows.time.size:
            return
        block = self._corrector.correct(rows.time, rows.readings, rows.kelvin)
        if rows.saturated is not None:
            flags = block.flags | rows.saturated * np.uint8(SampleFlag.SATURATED)
            block = CorrectedBlock(block.time, block.values, flags)
        self.summary.samples += block.time.size
        self.summary.flagged += int(np.count_nonzero(block.flags))
        self._output.put(block)
        self._output.flush()
        if self._output.lost and not self._told_loss:
            self._told_loss = True
            self._tell("the reader is too slow, so the oldest samples are lost")

    def _try_to_reopen(self) -> None:
        try:
            self._open = self._source.open()
        except InercalError:
            self._retry = min(2 * self._retry, _LONGEST_RETRY)
            self._next_attempt = monotonic() + self._retry
            return
        self.summary.reconnections += 1
        self._parser.restart(mid_stream=self._source.mid_stream)
        self._tell(f"opened {self._source.address} again")

    def _finish(self) -> None:
        """Send the last sample, and what still waits for the readers."""
        if self._ended:
            self._send(self._parser.finish())
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
        Address of the source, see `find_source`. With `?preset=NAME` or `?layout=FILE` it sends
        packets, otherwise lines of text.
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
    run = run if isinstance(run, Run) else read(run)
    if form not in FORMATS:
        raise InputError(f"no format {form!r}; possible: {', '.join(FORMATS)}", key="--format")
    corrector = LiveCorrector(calibration, run, extrapolate=extrapolate)
    found = find_source(source)
    parser: Parser
    if link_of_address(source) != source:
        parser = PacketRows(run, layout_of_address(source))
    else:
        layout = None if found.file is None else layout_of_file(run, found.file)
        parser = TextRows(run, found.address, layout, tell)
    format = FORMATS[form](corrector.names)
    kind = "" if to is None else to.partition(":")[0].lower()
    output: Output
    if to is None:
        output = DescriptorOutput(1, format)
    elif kind in ("tcp", "udp"):
        output = TcpOutput(to, format) if kind == "tcp" else UdpOutput(to, format)
    else:
        raise InputError(
            f"--to {to!r} is not an address; possible: tcp://{LOCAL}:5000 or udp://{LOCAL}:5000",
            key="--to",
        )
    with on_failure(output.close):
        return LiveCorrection(corrector, found, parser, output, tell)

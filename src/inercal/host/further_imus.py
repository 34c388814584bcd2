"""Further IMUs that a run reads: their bytes are recorded, and calibrated after the run.

The main IMU alone decides how the run proceeds. The bytes of a further IMU go to the log with their
arrival times, as frames of a kind of their own, and nothing waits for them. After the run, the
recording of each further IMU is computed from the log in the same way as that of the main IMU.

If the port of a further IMU was opened again, an empty frame in the log says so.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial

from inercal.basics.closeable import Closeable, on_failure
from inercal.basics.errors import InputError
from inercal.host.addresses import layout_of_address, open_imu
from inercal.host.clock import Clock, Tick
from inercal.host.imu_port import ImuPort, ImuReceiver
from inercal.host.link import LinkLost
from inercal.host.packets import Decoder
from inercal.host.recorder import RunRecorder
from inercal.host.run_folder import ALSO_IMU
from inercal.host.run_log import FURTHER_IMU

_PACKET_TIMEOUT = 5.0  # s; if no packet is found in the bytes for this time, the journal warns


class FurtherImus(Closeable):
    """Reads the further IMUs of a run and records their bytes.

    Parameters
    ----------
    addresses : mapping of str to str
        Addresses of the IMUs by name.
    clock : Clock
        Clock of the run.
    tick : Tick
        Tick of the bench at which the ports are opened.
    recorder : RunRecorder
    simulated : bool
        Whether the bench is simulated, so it counts the bytes that each IMU has sent.

    Raises
    ------
    InputError
        A simulated bench has another number of further IMUs.
    LinkLost
        An IMU does not answer at the beginning of a new run. In a resumed run, this is a warning.
    """

    def __init__(
        self,
        addresses: Mapping[str, str],
        clock: Clock,
        tick: Tick,
        recorder: RunRecorder,
        *,
        simulated: bool,
    ):
        if simulated and addresses and len(addresses) != len(tick.further_bytes):
            raise InputError(
                f"the simulated bench has {len(tick.further_bytes)} further IMUs, but {ALSO_IMU} "
                f"names {len(addresses)}: name all of them in the order in which they were printed",
                key=ALSO_IMU,
            )
        self._imus: list[_FurtherImu] = []
        with on_failure(self.close):
            for number, (name, address) in enumerate(addresses.items()):
                opener = partial(open_imu, address, clock.now, synchronous=simulated)
                try:
                    one = _FurtherImu(number, name, address, opener, tick, recorder)
                except LinkLost as error:
                    if not recorder.log_end.time:  # a new run
                        raise
                    words = f"{name} is gone, so this session does not record it: {error}"
                    recorder.record_message(tick.time, "warning", words)
                else:
                    self._imus.append(one)

    def take(self, tick: Tick) -> None:
        """Record the bytes that arrived before the tick."""
        for one in self._imus:
            one.take(tick)

    def close(self) -> None:
        """Close all ports."""
        for one in self._imus:
            one.close()


class _FurtherImu:
    """One further IMU."""

    def __init__(
        self,
        number: int,
        name: str,
        address: str,
        opener: Callable[[float], ImuPort],
        tick: Tick,
        recorder: RunRecorder,
    ):
        self._number, self._name, self._recorder = number, name, recorder
        self._opener = _BackgroundOpener(opener)
        self._receiver = ImuReceiver(self._opener, self._own_tick(tick))
        # Needed until it has found a packet.
        self._decoder: Decoder | None = Decoder(layout_of_address(address), mid_stream=True)
        self._start, self._warned = tick.time, False

    def take(self, tick: Tick) -> None:
        """Record the bytes that arrived before the tick, and warn once if there is a problem."""
        heard, kind = self._receiver.take(self._own_tick(tick)), FURTHER_IMU + self._number
        if heard.reopened:
            self._recorder.record_frame(kind, tick.time, b"")
        for time, data in heard.pieces:
            self._recorder.record_frame(kind, time, data)
            if self._decoder is not None and len(self._decoder.feed(data)):
                self._decoder = None
        trouble = self._receiver.trouble
        if self._decoder and tick.time > self._start + _PACKET_TIMEOUT:
            trouble = trouble or "no valid packet has arrived so far: check preset and baud"
        if trouble and not self._warned:
            self._warned = True
            words = f"{self._name}: {trouble}; the run continues, but its recording has a gap"
            self._recorder.record_message(tick.time, "warning", words)

    def _own_tick(self, tick: Tick) -> Tick:
        """Return the tick with the number of bytes that this IMU has sent."""
        counts = tick.further_bytes
        return tick._replace(bytes_sent=counts[self._number] if counts else None)

    def close(self) -> None:
        """Close the port."""
        self._receiver.close()
        self._opener.close()


class _BackgroundOpener:
    """Opens a port: at first at once, later in a thread, because the table must be polled."""

    def __init__(self, opener: Callable[[float], ImuPort]):
        self._open, self._opened_before = opener, False
        self._pool = ThreadPoolExecutor(1)
        self._attempt: Future[ImuPort] | None = None

    def __call__(self, timeout: float) -> ImuPort:
        """Return the open port; raises `LinkLost` if it is not open yet."""
        if not self._opened_before:
            self._opened_before = True
            return self._open(timeout)
        if self._attempt is None:
            self._attempt = self._pool.submit(self._open, timeout)
        if not self._attempt.done():
            raise LinkLost("the port is still being opened")
        attempt, self._attempt = self._attempt, None
        return attempt.result()

    def close(self) -> None:
        """Wait for the thread, and close a port that nobody has taken."""
        self._pool.shutdown()
        if self._attempt is not None:
            with suppress(LinkLost):
                self._attempt.result().close()

"""A simulated bench for a host: table and IMU as separate processes with real connections."""

import os
import subprocess
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from inercal.basics.errors import InputError
from inercal.estimation.kernel_options import on_compilation
from inercal.host.addresses import DeviceAddresses
from inercal.host.closeable import Closeable
from inercal.host.packets import read_layout
from inercal.host.precompilation import precompile_run
from inercal.host.sim import motion_link
from inercal.host.sim.bench_simulator import COUNTS_PER_TURN
from inercal.host.sim.mimu import COMPILING
from inercal.host.sim.simulated_errors import draw_errors
from inercal.runfile import Run, read

STARTUP_MESSAGE = "starting the simulated bench"
COMPILATION_MESSAGE = (
    "compiling the numerical code for this machine; this takes about a minute, the first time only"
)
_EXIT_TIMEOUT = 10.0  # s of wall time within which a process must exit by itself


class BenchSimulator(Closeable):
    """The simulated bench of a run file; a context manager that stops it at the end of the context.

    Its processes stop when the process that started them stops, which need not be the host.

    Parameters
    ----------
    run : path
        The run file, which states the bench, the sensor and the truth.
    seed : int
        Seed of all random numbers.
    preset : str
        Packet format of the IMU.
    rate_hz : float, optional
        Packet rate; by default the preset's own rate, or the rate of the run's data.
    pace : float or "granted"
        Bench seconds per second of wall time, or "granted": the host grants time through the clock.
    terminal : bool
        If True, the IMU is connected through a pseudo-terminal, otherwise through TCP.
    background_work : callable, optional
        Called while the processes start, which takes a while if they compile.
    compiling : callable, optional
        Called when kernels of the simulation are compiled instead of loaded.

    Attributes
    ----------
    table, imu : str
        Addresses that a host can open.
    clock : str or None
        Address of the clock; None if time passes by itself.
    addresses : DeviceAddresses
        All of these addresses, in the form that a run takes.

    Raises
    ------
    InputError
        The bench cannot be simulated; the message is that of the process.
    """

    def __init__(
        self,
        run: str | Path,
        seed: int = 0,
        preset: str = "fixed",
        rate_hz: float | None = None,
        pace: float | Literal["granted"] = "granted",
        terminal: bool = True,
        background_work: Callable[[], None] | None = None,
        compiling: Callable[[], None] = lambda: None,
    ):
        self._compiling = compiling
        with on_compilation(compiling):
            self._drawn_errors = draw_errors(read(run), seed)
        self._processes: dict[str, subprocess.Popen[str]] = {}
        # A process that was killed may leave files behind.
        self._folder = TemporaryDirectory(prefix="inercal-", ignore_cleanup_errors=True)
        common = [str(run), "--seed", str(seed)]
        try:
            rate = [] if rate_hz is None else ["--rate", repr(float(rate_hz))]
            place = ["--terminal"] if terminal else ["--port", "0"]
            folder = Path(self._folder.name)
            sends = ["--preset", preset, *rate, *place, "--folder", str(folder)]
            moves = ["--pace", str(pace), "--motion", f"unix:{folder / motion_link.SOCKET_NAME}"]
            self._start("imu", "mimu", *common, *sends, "--announce-compilation")
            self._start("table", "bench_simulator", *common, *moves)
            if background_work:
                background_work()
            imu, *_ = self._address("imu")
            table, *clock = self._address("table")
        except BaseException:
            # A process that waits for another one that has failed would not read the command to
            # stop.
            for process in self._processes.values():
                process.kill()
            self.close()
            raise
        motors = ",".join(f"{i + 1}" for i in range(len(self._drawn_errors.bench.names)))
        self.table = (
            f"{table.replace('tcp', 'pmac', 1)}?motors={motors}&counts={COUNTS_PER_TURN}"
            if self._drawn_errors.motion_control.has_attitude
            else f"motor:{table}"
        )
        self.imu = f"{imu}?preset={preset}"
        self.clock = clock[0] if clock else None
        self.addresses = DeviceAddresses(self.table, self.imu, self.clock or "")

    def inject_fault(self, which: Literal["table", "imu"], words: str) -> None:
        """Inject a fault into a process; see `sim.server.execute_commands` and `sim.mimu`.

        Raises
        ------
        InputError
            The process refuses the fault, or it has ended.
        """
        process = self._processes[which]
        assert process.stdin
        assert process.stdout
        try:
            process.stdin.write(f"{words}\n")
            process.stdin.flush()
            said = process.stdout.readline().strip()
        except OSError:
            said = ""
        if not said and words != "die":
            raise InputError(
                f"the process of the simulated {which} has ended; begin a new run", names=(which,)
            )
        if said.startswith("no: "):
            raise InputError(said.removeprefix("no: "), key="fault", names=(which,))

    @contextmanager
    def run_context(self) -> Generator[None]:
        """Keep this process and the table's on one processor, and the IMU's process on another.

        Host and table wait for each other. Waking one of them on another processor, particularly a
        virtual one, takes longer than the work it has to do. This has no effect on systems without
        such a setting.
        """
        if not hasattr(os, "sched_setaffinity") or len(all_of_them := os.sched_getaffinity(0)) < 2:
            yield
            return
        ours, others = sorted(all_of_them)[:2]
        _set_processors(self._processes["imu"].pid, {others})
        _set_processors(self._processes["table"].pid, {ours})
        _set_processors(os.getpid(), {ours})
        try:
            yield
        finally:
            _set_processors(os.getpid(), all_of_them)

    def close(self) -> None:
        """End the processes."""
        for process in self._processes.values():
            for end in (process.stdin, process.stdout):
                if end is not None:
                    # Commands that have not been sent yet are no longer needed.
                    with suppress(OSError):
                        end.close()
            try:
                process.wait(_EXIT_TIMEOUT)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._processes.clear()
        self._folder.cleanup()

    def _start(self, which: str, module: str, *options: str) -> None:
        self._processes[which] = subprocess.Popen(
            [sys.executable, "-P", "-m", f"inercal.host.sim.{module}", *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            # An interrupt at the terminal is meant for the host; the bench continues and is brought
            # to rest.
            start_new_session=True,
        )

    def _address(self, which: str) -> list[str]:
        """Return the words after `at` in the line in which a process reports its address."""
        told = self._processes[which].stdout
        assert told
        said = told.readline().strip()
        if said == COMPILING:
            self._compiling()
            said = told.readline().strip()
        if not said.startswith("at "):
            raise InputError(
                said.removeprefix("no: ")
                or f"the process of the simulated {which} ended before it was ready; begin again",
                names=(which,),
            )
        return said.split()[1:]


def start_bench_simulator(
    run: Run, seed: int, preset: str, compiling: Callable[[], None] = lambda: None
) -> BenchSimulator:
    """Start a bench whose time the host grants, and compile the host's kernels meanwhile.

    Parameters
    ----------
    run : Run
    seed, preset, compiling
        As in `BenchSimulator`; `compiling` is also called when this process compiles.

    Raises
    ------
    InputError
        As in `BenchSimulator`.
    """
    layout = read_layout(preset)

    def compile_host() -> None:
        with on_compilation(compiling):
            precompile_run(run, layout)

    return BenchSimulator(run.path, seed, preset, background_work=compile_host, compiling=compiling)


def _set_processors(process: int, on: set[int]) -> None:
    """Restrict all threads of a process to some processors."""
    with suppress(OSError):  # a thread may end meanwhile, or the system may lack this folder
        for thread in os.listdir(f"/proc/{process}/task"):
            os.sched_setaffinity(int(thread), on)

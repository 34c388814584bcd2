"""Simulate a bench for a host: table and IMU are separate processes with real connections."""

import os
import subprocess
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from inercal.basics.closeable import Closeable
from inercal.basics.errors import InputError
from inercal.estimation.kernel_options import on_compilation
from inercal.host.addresses import DeviceAddresses
from inercal.host.packets import read_layout
from inercal.host.preparation import precompile_run
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
    """The simulated bench of a run file; it is stopped at the end of the `with` block.

    The processes of the bench stop when the process that started them stops. This need not be the
    host.

    Parameters
    ----------
    run : path
        The run file; it states the bench, the sensor and the true coefficients.
    seed : int
        Seed of all random numbers.
    preset : str
        Packet format of the IMU.
    rate_hz : float, optional
        Packet rate. By default, it is the rate of the preset, or else the rate of the run's data.
    pace : float or "granted"
        Bench seconds per second of wall time. "granted" means that the host decides, through the
        clock, how far time advances.
    terminal : bool
        Whether the IMU is connected through a pseudo-terminal and not through TCP.
    imus : int
        Number of IMUs on the table; see `inercal.host.sim.simulated_errors.numbered_imu`.
    background_work : callable, optional
        Function that is called while the processes start. Starting takes some time if they compile.
    compiling : callable, optional
        Function that is called if kernels of the simulation must be compiled.

    Attributes
    ----------
    table, imu : str
        Addresses that a host can open.
    further_imus : dict of str to str
        Addresses of the further IMUs by name, "imu2" and so on.
    chamber : str
        Address of a temperature chamber, which runs on the time of the bench.
    clock : str or None
        Address of the clock; None if time passes by itself.
    addresses : DeviceAddresses
        All addresses, in the form that a run needs.

    Raises
    ------
    InputError
        The bench cannot be simulated; the message comes from the process.
    """

    def __init__(
        self,
        run: str | Path,
        seed: int = 0,
        preset: str = "fixed",
        rate_hz: float | None = None,
        pace: float | Literal["granted"] = "granted",
        terminal: bool = True,
        imus: int = 1,
        background_work: Callable[[], None] | None = None,
        compiling: Callable[[], None] = lambda: None,
    ):
        self._compiling = compiling
        with on_compilation(compiling):
            self._drawn_errors = draw_errors(read(run), seed)
        self._processes: dict[str, subprocess.Popen[str]] = {}
        # A process that is killed may leave files behind.
        self._folder = TemporaryDirectory(prefix="inercal-", ignore_cleanup_errors=True)
        common = [str(run), "--seed", str(seed)]
        try:
            rate = [] if rate_hz is None else ["--rate", repr(float(rate_hz))]
            place = ["--terminal"] if terminal else ["--port", "0"]
            folder = Path(self._folder.name)
            sends = ["--preset", preset, *rate, *place, "--folder", str(folder)]
            sends += ["--imus", str(imus)]
            moves = ["--pace", str(pace), "--motion", f"unix:{folder / motion_link.SOCKET_NAME}"]
            self._start("imu", "mimu", *common, *sends, "--announce-compilation")
            self._start("table", "bench_simulator", *common, *moves)
            if background_work:
                background_work()
            imu, *further = self._address("imu")[:imus]
            table, self.chamber, *clock = self._address("table")
        except BaseException:
            # If one process has failed, the other may wait for it and would not read the command to
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
        self.further_imus = {
            f"imu{number}": f"{address}?preset={preset}"
            for number, address in enumerate(further, start=2)
        }
        self.clock = clock[0] if clock else None
        self.addresses = DeviceAddresses(self.table, self.imu, self.clock or "")

    def inject_fault(self, which: Literal["table", "imu"], words: str) -> None:
        """Inject a fault into a process; see `sim.server.execute_commands` and `sim.mimu`.

        Raises
        ------
        InputError
            The process does not accept the fault, or it has ended.
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
        """Run this process and the table's process on one processor, and the IMU's on another.

        Host and table wait for each other. Waking a process on another processor, particularly a
        virtual processor, takes longer than its work. On systems without such a setting, this has
        no effect.
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
                    # Commands that were not sent yet are no longer needed.
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
            # An interrupt at the terminal is meant for the host. The bench continues, and the host
            # brings it to rest.
            start_new_session=True,
        )

    def _address(self, which: str) -> list[str]:
        """Read the line in which a process reports its address; return the words after `at`."""
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
    """Start a bench whose time the host controls; meanwhile, compile the host's kernels.

    Parameters
    ----------
    run : Run
    seed, preset, compiling
        See `BenchSimulator`; `compiling` is also called if this process must compile.

    Raises
    ------
    InputError
        See `BenchSimulator`.
    """
    layout = read_layout(preset)

    def compile_host() -> None:
        with on_compilation(compiling):
            precompile_run(run, layout)

    return BenchSimulator(run.path, seed, preset, background_work=compile_host, compiling=compiling)


def _set_processors(process: int, on: set[int]) -> None:
    """Restrict all threads of a process to some processors."""
    with suppress(OSError):  # a thread may end meanwhile, or the system has no such folder
        for thread in os.listdir(f"/proc/{process}/task"):
            os.sched_setaffinity(int(thread), on)

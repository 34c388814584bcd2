"""What is compiled before a run: all that it works with while a table turns."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from tests.base_seeds import evidence
from tests.host.simulated_runs import plan
from tests.host.synthetic_log import LAYOUT, run_file

from inercal.host import preparation as host_compile
from inercal.host.bench_simulator import BenchSimulator
from inercal.host.packets import PacketLayout, read_layout

RUN = """
import sys
from pathlib import Path
from numba.core import event
from tests.host.simulated_runs import carried_out, plan
from inercal.host.preparation import precompile_run
from inercal.host.packets import read_layout
from inercal.host.bench_simulator import BenchSimulator


class Late(event.Listener):
    def on_start(self, event):
        print("late:", event.data["dispatcher"], event.data["args"])

    def on_end(self, event):
        pass


folder = Path(sys.argv[1])
replaced = [] if sys.argv[2] == "turntable_kalman" else [(
    'name = "turntable_kalman"', f'name = "{sys.argv[2]}"')]
run = plan(folder / "plan", replaced=replaced)
with BenchSimulator(run.path, seed=1) as bench:
    precompile_run(run, read_layout("fixed"))
    event.register("numba:compile", Late())
    ended = carried_out(folder / "run", bench, run)
print("done" if ended.done else ended.words)
"""


@pytest.mark.evidence
@pytest.mark.parametrize("method", [evidence("turntable_kalman"), "turntable_discrete"])
def test_a_run_compiles_nothing_more(tmp_path: Path, method: str):
    made = subprocess.run(
        [sys.executable, "-c", RUN, str(tmp_path), method],
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")},
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
    )
    assert made.stdout.splitlines() == ["done"], made.stdout + made.stderr


@pytest.mark.slow
def test_a_process_of_the_bench_says_that_it_compiles_only_when_it_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    run = plan(tmp_path / "plan")
    compiled: list[str] = []
    with BenchSimulator(run.path, seed=1):
        pass  # this process and the table's have their kernels
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    for _ in range(2):
        with BenchSimulator(run.path, seed=1, compiling=lambda: compiled.append("")):
            compiled.append("ready")
    # The IMU's process compiles the first time; those of this process are loaded already.
    assert compiled == ["", "ready", "ready"]


@pytest.mark.parametrize(
    "name",
    [
        "fixed",
        "ascii",
        *(pytest.param(n, marks=pytest.mark.slow) for n in ("novatel", "vn100", "xsens")),
    ],
)
def test_a_rest_is_assembled_in_two_pieces_by_packets_of_every_kind(tmp_path: Path, name: str):
    layout: PacketLayout = LAYOUT if name == "fixed" else read_layout(name)
    rate = layout.rate_hz or 200.0
    run = run_file(tmp_path, **{'rate = "100 Hz"': f'rate = "{rate:g} Hz"'})
    tracks = host_compile._assemble_rest(run, layout)
    assert len(tracks) == 2
    assert all((track.hold == 0).any() for track in tracks)

"""A bench that goes on by itself, as iron does: the host keeps pace and loses no packet.

How often the table is polled is up to the machine, too: where others have its processors, angles
between polls far apart are not known, and a host that was kept from it for long repeats a step.
"""

from pathlib import Path
from time import monotonic

import pytest
from tests.host.simulated_runs import SHORT, carried_out, plan

from inercal.host.bench_simulator import BenchSimulator
from inercal.host.preparation import precompile_run


@pytest.mark.evidence
@pytest.mark.parametrize("rate", [200, 1000])
def test_for_more_than_a_minute_in_real_time_no_packet_is_lost(tmp_path: Path, rate: int):
    path = SHORT.replace("22", "40")
    run = plan(tmp_path / "plan", path, [('rate = "200 Hz"', f'rate = "{rate} Hz"')])
    precompile_run(run)
    with BenchSimulator(run.path, seed=4, rate_hz=rate, pace=1.0) as bench:
        begun = monotonic()
        ended = carried_out(tmp_path / "run", bench, run, poll=0.02)
        wall = monotonic() - begun
    assert ended.done, ended.words
    assembly = ended.run.recorder.assembly
    print(
        f"{rate} Hz: {assembly.imu.counts}, "
        f"{wall:.1f} s of the wall, {ended.run.time:.1f} s of the run",
        ended.words,
    )
    assert (assembly.imu.counts.lost, assembly.imu.counts.failed) == (0, 0)
    assert ended.sections[-1][2] - ended.sections[0][1] > 60 - 5
    assert abs(assembly.imu.counts.packets - rate * ended.run.time) < 2 * rate

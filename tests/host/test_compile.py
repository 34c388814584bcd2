"""What is compiled before a run: all that it works with while a table turns."""

from pathlib import Path

import pytest
from tests.host.bench_log import LAYOUT, run_file

from inercal.host import compile as host_compile
from inercal.host.packets import Layout, read_layout


@pytest.mark.parametrize("name", ["fixed", "ascii", "novatel", "vn100", "xsens"])
def test_a_rest_is_assembled_in_two_pieces_by_packets_of_every_kind(tmp_path: Path, name: str):
    layout: Layout = LAYOUT if name == "fixed" else read_layout(name)
    rate = layout.rate_hz or 200.0
    run = run_file(tmp_path, **{'rate = "100 Hz"': f'rate = "{rate:g} Hz"'})
    tracks = host_compile._assembled(run, layout)
    assert len(tracks) == 2
    assert all((track.hold == 0).any() for track in tracks)

"""The stations of the architecture page are those through which a recording goes."""

import re
import sys
from pathlib import Path
from types import FrameType

from tests.program import run_program

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "inercal"
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
WAY = PAGE.partition("## The path of a recording")[2].partition("\n## ")[0]
STATIONS = re.findall(r"^\| .* \| \[`(\w+)`\]\(\.\./src/inercal/(.*)\) \|$", WAY, re.MULTILINE)


def test_there_are_at_most_twenty_five_stations():
    assert 20 < len(STATIONS) <= 25


def test_a_calibration_calls_the_stations_in_their_order(tmp_path: Path):
    run_file = tmp_path / "run.toml"
    run_file.write_bytes((ROOT / "examples" / "ferraris_simulated" / "run.toml").read_bytes())
    assert not run_program("simulate", run_file).status
    station = {(name, str(SOURCE / file)): (name, file) for name, file in STATIONS}
    called: list[tuple[str, str]] = []

    def note(frame: FrameType, event: str, _: object) -> None:
        key = frame.f_code.co_name, frame.f_code.co_filename
        if event == "call" and key in station:
            called.append(station.pop(key))

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        ended = run_program("calibrate", run_file, "-o", tmp_path)
    finally:
        sys.setprofile(before)
    assert not ended.status
    assert called == STATIONS

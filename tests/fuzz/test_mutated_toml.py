"""Run files and descriptions of packets, changed anywhere: used, or refused by one line."""

from importlib.resources import files
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, seed, settings
from tests.base_seeds import evidence, slow
from tests.fuzz.toml_mutations import mutated

from inercal.basics.errors import InercalError
from inercal.host.packets.description import PRESETS, parse_layout
from inercal.host.packets.stream import Decoder
from inercal.runfile import read

EXAMPLES = Path(__file__).parents[2] / "examples"
RUN_FILES = {
    path: path.read_text("utf-8")
    for path in sorted(EXAMPLES.rglob("*.toml"))
    if path.parent.name not in ("own_bench", "own_driver") and path.name != "packets.toml"
}
_PRESETS = files("inercal.host.packets") / "presets"
DESCRIPTIONS = tuple(
    path.read_text("utf-8")
    for path in [*(_PRESETS / f"{name}.toml" for name in PRESETS), EXAMPLES / "bench/packets.toml"]
)
BYTES = bytes(range(256)) * 8 + b"1,2,3,4,5,6,7\r\n" * 20
COUNTS = [
    pytest.param(50),
    slow(300),
    evidence(100_000),
]


def tried(count: int) -> settings:
    checks = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
    return settings(max_examples=count, deadline=None, database=None, suppress_health_check=checks)


def require_one_line(error: InercalError) -> None:
    assert str(error)
    assert "\n" not in str(error)


@pytest.mark.slow
@pytest.mark.parametrize("count", COUNTS)
def test_a_mutated_run_file_is_read_or_refused_by_one_line(tmp_path: Path, count: int):
    folders = {text: path.parent for path, text in RUN_FILES.items()}
    refused = 0

    @seed(count)
    @tried(count)
    @given(mutated(tuple(folders)))
    def once(text: str) -> None:
        nonlocal refused
        path = tmp_path / "run.toml"
        path.write_text(text, "utf-8", errors="surrogatepass")
        try:
            read(path)
        except InercalError as error:
            require_one_line(error)
            refused += 1

    once()
    assert 0.1 * count < refused < count


@pytest.mark.slow
@pytest.mark.parametrize("count", COUNTS)
def test_a_mutated_description_of_packets_decodes_any_bytes_or_is_refused(count: int):
    refused = 0

    @seed(count)
    @tried(count)
    @given(mutated(DESCRIPTIONS))
    def once(text: str) -> None:
        nonlocal refused
        try:
            layout = parse_layout(text, "packets.toml")
        except InercalError as error:
            require_one_line(error)
            refused += 1
            return
        decoder = Decoder(layout)
        decoder.feed(BYTES)
        decoder.feed(BYTES[7:])

    once()
    assert 0.1 * count < refused < count

"""Small files: whatever stands in their place, reading ends, in one line."""

import os
import tracemalloc
from pathlib import Path

import pytest
from tests.refusals import refused

from inercal.basics.small_files import DEEPEST, LARGEST, parse_toml, read_small_file, read_toml
from inercal.host.packets.description import read_layout
from inercal.runfile import read

READERS = [read, read_layout, read_toml]


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("device", ["/dev/zero", "/dev/urandom", "/dev/null", "/proc/self/mem"])
def test_a_device_is_refused_at_once(reader: object, device: str):
    if not Path(device).exists():
        pytest.skip(f"this system has no {device}")
    with refused(file=Path(device)):
        reader(device if reader is not read_toml else Path(device))  # type: ignore[operator]


@pytest.mark.parametrize("reader", READERS)
def test_a_fifo_without_a_writer_is_refused_at_once(tmp_path: Path, reader: object):
    path = tmp_path / "run.toml"
    os.mkfifo(path)
    with refused(file=path):
        reader(path)  # type: ignore[operator]


@pytest.mark.parametrize("reader", READERS)
def test_a_file_that_is_too_large_is_refused(tmp_path: Path, reader: object):
    path = tmp_path / "run.toml"
    path.write_bytes(b"#" * (LARGEST + 1))
    with refused(file=path):
        reader(path)  # type: ignore[operator]


@pytest.mark.parametrize("text", ["a = " + "[" * 2000 + "]" * 2000, "a" + ".a" * 1500 + " = 1"])
@pytest.mark.parametrize("reader", READERS)
def test_a_file_nested_deeply_is_refused(tmp_path: Path, reader: object, text: str):
    path = tmp_path / "run.toml"
    path.write_text(text)
    with refused(file=path.name):
        reader(path)  # type: ignore[operator]


@pytest.mark.parametrize("part", ["a", "'a b'", '"a.b"', "é"])
@pytest.mark.parametrize("around", ["{} = 1", "[{}]", "x = {{ {} = 1 }}", "[[ {} ]]"])
def test_a_deep_key_is_refused_before_it_takes_memory(part: str, around: str):
    """Parsed, a key of 100 000 levels takes gigabytes."""
    text = around.format(" . ".join([part] * 100_000))
    tracemalloc.start()
    with refused():
        parse_toml(text)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20 * len(text)


@pytest.mark.parametrize(
    "text",
    [
        'x = "{}"',
        "x = '{}'",
        'x = """\n{}\n\\"""',
        "x = '''\n{}\n'''",
        "# {}\nx = 1",
        'x = "\\"{}"',
        "x = [" + "1.5, 2.5, " * 100 + "]  # {}",
    ],
)
def test_dots_in_strings_and_comments_are_no_levels(text: str):
    text = text.replace('\\"""', '"""').format(".".join("a" * 100))
    assert list(parse_toml(text)) == ["x"]


def test_nesting_up_to_the_limit_is_accepted():
    inner = DEEPEST - 1
    assert parse_toml("a = " + "[" * inner + "]" * inner)
    with refused():
        parse_toml("a = " + "[" * (inner + 1) + "]" * (inner + 1))


def test_a_file_of_the_largest_size_is_read_whole(tmp_path: Path):
    path = tmp_path / "file"
    path.write_bytes(b"x" * 100)
    assert read_small_file(path, largest=100) == b"x" * 100
    with refused(file=path):
        read_small_file(path, largest=99)


def test_a_name_that_no_file_can_have_is_refused():
    with refused():
        read("a\0b")


def test_a_binary_file_is_called_binary():
    with refused(line=None) as caught:
        parse_toml(b"\x89PNG\r\n\x1a\n\0\0\0", "run file")
    assert "binary" in str(caught.value)

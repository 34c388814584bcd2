"""A number that is far too large or too small is refused in one line, in every key."""

from pathlib import Path
from typing import Any

import pytest
from tests.runfile.key_sweep import NUMBER, calibrated, example, keys, with_key

from inercal.basics.errors import InputError

FILES = ("six_position/run.toml", "dividing_head/tumble.toml", "dividing_head/lab.toml")
FILES = (*FILES, "centrifuge/lab.toml", "turntable/mimu.toml", "magnetometer/nine_axes.toml")


def with_number(value: Any, number: str, part: str) -> Any:
    """Return a value, or one of several, with another number; None if there is no number in it."""
    if isinstance(value, list | tuple):
        first = with_number(value[0], number, part) if value else None
        return None if first is None else [first, *value[1:]]
    if isinstance(value, float | int) and not isinstance(value, bool):
        return float(number)
    if not isinstance(value, str) or not NUMBER.match(value):
        return None
    first, sign, deviation = value.partition("±")
    if part == " ±":
        return f"{first}{sign}{NUMBER.sub(number, deviation, count=1)}"
    return NUMBER.sub(number, first, count=1) + sign + deviation


@pytest.mark.parametrize("path", FILES)
@pytest.mark.parametrize("number", ["1e300", "-1e300", "1e-300"])
def test_an_impossible_number_is_refused_in_every_key(path: str, number: str, tmp_path: Path):
    content = example(path)
    tried = 0
    for key, field, stated in keys(content, kept=lambda _: True):
        shown = field.examples or (None,)
        value = with_number(stated, number, key.part) or with_number(shown[0], number, key.part)
        if value is None or (isinstance(value, float) and number == "1e-300"):
            continue  # a plain number that is nearly zero is zero
        tried += 1
        with pytest.raises(InputError) as refusal:
            print(key, value, calibrated(tmp_path, with_key(content, key, value)))
        assert "\n" not in str(refusal.value)
    assert tried > 10

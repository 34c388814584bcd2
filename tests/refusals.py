"""Errors by their type and data, not by their wording."""

from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

import pytest

from inercal.basics.errors import InercalError, InputError


@contextmanager
def refused(
    kind: type[InercalError] = InputError, **data: Any
) -> Generator[pytest.ExceptionInfo[InercalError]]:
    """Expect an error of this type whose attributes are as stated.

    `names` is compared without its order, and `file` by its name alone where a text is given.
    """
    with pytest.raises(kind) as refusal:
        yield refusal
    error = refusal.value
    assert not str(error).endswith(":"), f"the message has lost its end: {error}"
    for name, expected in data.items():
        got = getattr(error, name)
        if name == "names":
            got, expected = sorted(got), sorted(expected)
        elif name == "file" and isinstance(expected, str) and got is not None:
            got = got.name
        assert got == expected, f"{name} of: {error}"

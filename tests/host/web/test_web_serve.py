"""`inercal bench serve`: what it is given is what it serves by."""

from typing import Any

import pytest

from inercal.cli.bench_serve import serve
from inercal.errors import InputError
from inercal.host.run import Options
from inercal.host.web import server


def test_limits_of_runs_are_taken_as_of_bench_run(monkeypatch: pytest.MonkeyPatch):
    given: list[server.Options] = []
    monkeypatch.setattr(server, "serve", given.append)
    serve()
    serve(speed=20.0, temperature="15:40", patience=30.0)
    ordinary, watched = (one.of_runs for one in given)
    assert ordinary == Options()
    assert watched == Options(20.0, (288.15, 313.15), 30.0)


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ({"temperature": "40:15"}, "give lowest and highest °C, as 15:40"),
        ({"temperature": "40"}, "give lowest and highest °C, as 15:40"),
        ({"patience": 0.0}, "--patience 0.0; give a number above 0"),
        ({"speed": -1.0}, "--speed -1.0; give a number above 0"),
    ],
)
def test_limits_that_are_none_are_refused_before_anything_is_served(
    option: dict[str, Any], words: str
):
    with pytest.raises(InputError, match=words):
        serve(**option)

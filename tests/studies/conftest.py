"""One run of each study for all tests of it."""

import pytest

from inercal.studies import Study, reproduce


@pytest.fixture(scope="session")
def study() -> Study:
    """Return the study with few trials; what is judged there does not hang on their number."""
    return reproduce("centrifuge", trials=100, seed=1)


@pytest.fixture(scope="session")
def dual_orthogonal() -> Study:
    """Return the other study, likewise."""
    return reproduce("dual-orthogonal", trials=100, seed=1)


@pytest.fixture(scope="session")
def ship_model() -> Study:
    """Return the third study, likewise."""
    return reproduce("ship-model", trials=100, seed=1)


@pytest.fixture(scope="session")
def turntable() -> Study:
    """Return the fourth study, of six devices."""
    return reproduce("turntable", trials=100, seed=1)


@pytest.fixture(params=["study", "dual_orthogonal", "ship_model", "turntable"])
def each_study(request: pytest.FixtureRequest) -> Study:
    """Return one study after the other."""
    return request.getfixturevalue(request.param)

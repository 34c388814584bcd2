"""One run of the study of the centrifuge for all tests of it."""

import pytest

from inercal.studies import Study, reproduce


@pytest.fixture(scope="session")
def study() -> Study:
    """Return the study with few trials; what is judged there does not hang on their number."""
    return reproduce("centrifuge", trials=400, seed=1)

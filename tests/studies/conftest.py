"""One run of each study, shared by all its tests."""

import pytest

from inercal.studies import Study, reproduce
from inercal.studies.turntable import turntable_trials


@pytest.fixture(scope="session")
def centrifuge_study() -> Study:
    """Return the study with few trials; what is judged there does not hang on their number."""
    return reproduce("centrifuge", trials=100, seed=1)


@pytest.fixture(scope="session")
def dual_orthogonal_study() -> Study:
    """Return the other study, likewise."""
    return reproduce("dual-orthogonal", trials=100, seed=1)


@pytest.fixture(scope="session")
def ship_model_study() -> Study:
    """Return the third study, likewise."""
    return reproduce("ship-model", trials=100, seed=1)


@pytest.fixture(scope="session")
def two_devices() -> turntable_trials.TurntableTrials:
    """Return the results of the fourth study's filters on two devices, each of half an hour."""
    return turntable_trials.run_filters(2, 7, lambda _: None)


@pytest.fixture(scope="session")
def turntable_study(two_devices: turntable_trials.TurntableTrials) -> Study:
    """Return the fourth study of these two; six decide some verdicts, in a slow test."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(turntable_trials, "run_filters", lambda *_: two_devices)
        return reproduce("turntable", trials=400, seed=1)


@pytest.fixture(
    params=[
        "centrifuge_study",
        pytest.param("dual_orthogonal_study", marks=pytest.mark.slow),
        pytest.param("ship_model_study", marks=pytest.mark.slow),
        pytest.param("turntable_study", marks=pytest.mark.evidence),
    ]
)
def each_study(request: pytest.FixtureRequest) -> Study:
    """Return one study after the other."""
    return request.getfixturevalue(request.param)

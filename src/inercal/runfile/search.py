"""What a run file says of a search: [method.search]."""

from typing import Any

from inercal.errors import InputError
from inercal.methods import Method, ship_multi_angle
from inercal.methods.ship_multi_angle.global_search import Bounds, SearchOptions
from inercal.runfile.schema import MethodSection, SearchSection
from inercal.section_settings import si_value
from inercal.sensors import G0

_KEY = "[method.search]"


def search_options(
    section: MethodSection, chosen: Method[Any, Any], estimator: str
) -> SearchOptions | None:
    """Return what the search is told, or None for an estimator that does not search.

    Raises
    ------
    InputError
        A section for such an estimator, or a value out of place.
    """
    if chosen is not ship_multi_angle.METHOD or estimator != "global":
        if section.search is not None:
            raise InputError(
                f"{_KEY} is for estimator global of ship_multi_angle; {estimator} of "
                f"{chosen.name} does not search"
            )
        return None
    told = section.search or SearchSection.model_validate({})
    goal = _positive_value(told, "goal", "1")
    if goal >= 1:
        raise InputError(f"{_KEY} goal: {told.goal!r} must be less than 100 %")
    bounds = Bounds(
        _positive_value(told, "scale_error", "1"),
        _positive_value(told, "cross_axis", "1"),
        _positive_value(told, "bias", "m/s²") / G0,
    )
    return SearchOptions(bounds, told.seed, _positive_value(told, "time_limit", "s"), goal)


def _positive_value(section: SearchSection, name: str, like: str) -> float:
    text = getattr(section, name)
    value = si_value(text, like, f"{_KEY} {name}")
    if not value > 0:
        raise InputError(f"{_KEY} {name}: {text!r} must be positive")
    return value

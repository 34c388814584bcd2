"""Read [method] of a run file: the plan, the frame of the result and the search options."""

from collections.abc import Callable
from functools import partial
from inspect import signature
from typing import TYPE_CHECKING, Any

from inercal.basics.errors import InputError
from inercal.methods import METHODS, Method
from inercal.physics.plan import Step
from inercal.physics.section_settings import key_error, positive_value, si_value
from inercal.physics.sensors import G0
from inercal.runfile.schema import MethodSection, SearchSection

if TYPE_CHECKING:
    from inercal.methods.ship_multi_angle.norm_equations import SearchOptions

# [method] keys for the plan: key, example unit, argument of the method's plan
_PLAN = (
    ("seconds", "s", "seconds"),
    ("turn", "°", "angle"),
    ("turn_seconds", "s", "turn_seconds"),
    ("positions", "", "positions"),
    ("reverse", "", "reverse"),
    ("attitudes", "", "attitudes"),
    ("rates", "rpm", "rates"),
    ("small_rates", "rpm", "small_rates"),
    ("small_tilts", "°", "small_tilts"),
    ("warm_up", "", "warm_up"),
    ("turns", "", "turns"),
    ("path", "", "path"),
)
_MOST_POSITIONS = 1000  # planning would take hours if a number were mistyped
_SENSE = ", or negative for a turn clockwise seen from above"
_SEARCHING_METHOD = "ship_multi_angle"
_SEARCH = "[method.search]"


def stated_plan_keys(section: MethodSection) -> dict[str, Any]:
    """Return the plan keys stated in the run file, with their values as written."""
    return {key: value for key, _, _ in _PLAN if (value := getattr(section, key)) is not None}


def nominal_plan(
    chosen: Method[Any, Any], section: MethodSection
) -> Callable[[], tuple[Step, ...]]:
    """Return the method's plan with the options stated in the section.

    Raises
    ------
    InputError
        The plan of this method does not have the key, or a value is not positive.
    """
    possible = signature(chosen.plan).parameters
    stated = stated_plan_keys(section)
    options: dict[str, Any] = {}
    for key, like, option in _PLAN:
        if key not in stated:
            continue
        place = f"[method] {key}"
        if option not in possible:
            keys = ", ".join(key for key, _, option in _PLAN if option in possible)
            raise key_error(
                place, f"the plan of {chosen.name} has no such option; its options are {keys}"
            )
        options[option] = _plan_option(stated[key], like, place)
    return partial(chosen.plan, **options)


def _plan_option(given: str | bool | int | tuple[str, ...], like: str, key: str) -> Any:
    """Convert a plan key to an argument: a word, a boolean, a number or quantities in SI units."""
    if isinstance(given, tuple):
        return tuple(_plan_option(each, like, key) for each in given)
    if isinstance(given, bool) or (isinstance(given, str) and not like):
        return given
    value = given if isinstance(given, int) else si_value(given, like, key)
    if value == 0 or (like not in ("°", "rpm") and value < 0):
        raise InputError(f"{key}: {given!r} must be positive{_SENSE * (like == '°')}", key=key)
    if key == "[method] positions" and value > _MOST_POSITIONS:
        raise InputError(f"{key}: {given} is too many; give {_MOST_POSITIONS} or fewer", key=key)
    return value


def stated_also(section: MethodSection, chosen: Method[Any, Any]) -> tuple[str, ...]:
    """Return the coefficients stated in [method] also, or an empty tuple for "auto".

    Raises
    ------
    InputError
        "auto" is stated for an estimator that cannot estimate more coefficients.
    """
    if section.also != "auto":
        return section.also
    if section.estimator in chosen.closed_formulas:
        other = next(iter(chosen.estimators))
        raise InputError(
            f'[method] also: "auto" is not possible with estimator {section.estimator}, whose '
            f"formulas cannot take more coefficients; use estimator {other}, or remove the key",
            key="[method] also",
            names=(section.estimator,),
        )
    return ()


def require_frame(frame: str, chosen: Method[Any, Any], estimator: str) -> None:
    """Raise an error if a frame is stated but the estimator uses its own frame.

    Raises
    ------
    InputError
        The estimator does not support a frame; the message names the estimators that do.
    """
    if frame == "mount" or estimator in chosen.norm_only_estimators:
        return
    possible = "; ".join(
        f"{' and '.join(each.norm_only_estimators)} of {each.name}"
        for each in METHODS.values()
        if each.norm_only_estimators
    )
    raise InputError(
        f"[sensor] frame: estimator {estimator} of {chosen.name} does not support frame "
        f"{frame!r}; remove frame, or use an estimator that uses only norms: {possible}",
        key="[sensor] frame",
        names=(estimator,),
    )


def search_options(
    section: MethodSection, chosen: Method[Any, Any], estimator: str
) -> "SearchOptions | None":
    """Return the search options, or None if the estimator does not search.

    Raises
    ------
    InputError
        [method.search] is stated but the estimator does not search, or a value is not possible.
    """
    if chosen.name != _SEARCHING_METHOD or estimator != "global":
        if section.search is not None:
            raise InputError(
                f"{_SEARCH} is used only by estimator global of ship_multi_angle; {estimator} of "
                f"{chosen.name} does not search: remove {_SEARCH}",
                key=_SEARCH,
                names=(estimator,),
            )
        return None
    from inercal.methods.ship_multi_angle.norm_equations import Bounds, SearchOptions

    search = section.search or SearchSection.model_validate({})
    goal = _positive_value(search, "goal", "1")
    if goal >= 1:
        key = f"{_SEARCH} goal"
        raise InputError(f"{key}: {search.goal!r} must be less than 100 %", key=key)
    bounds = Bounds(
        _positive_value(search, "scale_error", "1"),
        _positive_value(search, "cross_axis", "1"),
        _positive_value(search, "bias", "m/s²") / G0,
    )
    return SearchOptions(bounds, search.seed, _positive_value(search, "time_limit", "s"), goal)


def _positive_value(section: SearchSection, name: str, like: str) -> float:
    return positive_value(getattr(section, name), like, f"{_SEARCH} {name}")

"""Define base classes for the sections of a run file, and convert their quantities to SI.

A section is a pydantic model in which values with units are text, such as "60 µg/√Hz". A key has an
example if its default is None or uninformative; error messages show this example.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, NamedTuple, TypedDict, TypeVar, Unpack, overload

from pydantic import BaseModel, ConfigDict, Field, JsonValue, model_validator

from inercal.basics.errors import InputError, error_location
from inercal.basics.units import Measured, parse_quantity
from inercal.physics.earth import gravity_at_unknown_height, normal_gravity


class Limit(NamedTuple):
    """The largest plausible deviation, SI, and what it means: "a bench can tilt, 1°"."""

    value: float
    meaning: str


_MIDDLE_LATITUDE = 0.785  # rad
_EARTH_GRAVITY = (9.76, 9.84)  # m/s², from 9.7639 on Huascarán to 9.8337 on the Arctic Ocean
_GRAVITY_RANGE = 0.08  # m/s², between the equator, the poles and all inhabited heights
# The estimators neglect the square of a tilt.
SMALL_ANGLE = Limit(0.0175, "a bench can tilt, 1°")
# Keys that do not affect any result: names, and the true values of a simulation.
DESCRIPTION: dict[str, JsonValue] = {"role": "description"}
# Keys that affect only the plan or its simulation: limits of a table's motion, and the position of
# the IMU on it, because accelerometers are used only at rest.
PLANNING: dict[str, JsonValue] = {"role": "plan"}


@dataclass(frozen=True)
class BenchUsage:
    """How a run uses its bench, which decides which keys of the bench have an effect.

    Parameters
    ----------
    method : str
    turns : bool
        Whether the plan has turns by known angles.
    attitudes : bool
        Whether the method knows the attitudes; otherwise it estimates them.
    gyros : bool
        Whether the sensor has gyros.
    means : bool
        Whether the data are means rather than samples.
    rest : bool
        Whether the whole recording is one rest.
    angles : bool
        Whether the angles of a table are used.
    magnetometers : bool
        Whether the sensor has magnetometers.
    one_file : bool
        Whether all sections are from one recording.
    qualified : tuple of str
        Keys of [bench] whose values come from a qualification.
    """

    method: str
    turns: bool
    attitudes: bool
    gyros: bool
    means: bool
    rest: bool = False
    angles: bool = True
    magnetometers: bool = False
    one_file: bool = False
    qualified: tuple[str, ...] = ()


class _Rules(TypedDict, total=False):
    ge: float
    gt: float
    le: float
    allow_inf_nan: bool
    json_schema_extra: dict[str, JsonValue]


_T = TypeVar("_T")


@overload
def optional(*examples: object, about: str = "", **rules: Unpack[_Rules]) -> None: ...
@overload
def optional(*examples: object, about: str = "", default: _T, **rules: Unpack[_Rules]) -> _T: ...
def optional(
    *examples: object, about: str = "", default: object = None, **rules: Unpack[_Rules]
) -> object:
    """Declare a key with a default; its examples come first, and `about` says what it means."""
    return Field(default, description=about or None, examples=list(examples) or None, **rules)


class Section(BaseModel):
    """A section of a run file; it rejects keys that it does not declare."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


MISSING_GRAVITY = 'give gravity = "9.81 m/s² ± 0.1 mm/s²" or latitude (and height)'


class BenchSection(Section):
    """The keys of [bench] that every kind of bench has.

    Gravity is given, or computed from latitude and height.
    """

    gravity: str | None = optional("9.8073 m/s² ± 0.2 mm/s²")
    latitude: str | None = optional("48.1 °")
    height: str | None = optional("520 m")
    qualification: str | tuple[str, ...] | None = optional(
        "head.qualification.json", about="files from inercal qualify, which replace keys"
    )
    name: str = optional(
        "table 2",
        default="",
        about="the laboratory's name for the bench",
        json_schema_extra=DESCRIPTION,
    )
    check_standard: str | None = optional(
        "REF-1.control.json", about="file from inercal control: the check standard of this bench"
    )
    check_standard_age: str | None = optional(
        "24 h", about="longest time allowed between its last measurement and the run"
    )

    missing_gravity: ClassVar[str] = MISSING_GRAVITY

    @property
    def without_gravity(self) -> bool:
        """Whether this kind of bench has a method that does not need gravity."""
        return False

    @model_validator(mode="after")
    def _gravity_is_known(self) -> "BenchSection":
        if self.gravity is None and self.latitude is None and not self.without_gravity:
            raise ValueError(self.missing_gravity)
        if self.height is not None and self.latitude is None:
            raise ValueError(
                "height also needs latitude: gravity is computed from both; add latitude or remove "
                "height"
            )
        return self

    def unused_keys(self, use: BenchUsage) -> dict[str, str]:
        """Return the keys that do not affect any result in this usage, each with the reason."""
        return {}


def key_error(
    key: str, text: str, file: Path | None = None, names: tuple[str, ...] = ()
) -> InputError:
    """Return the error for a key of a run file: "run.toml: [bench] radius: …" or "… is missing"."""
    where = key if file is None else f"{file}: {key}"
    colon = "" if text.startswith(("is ", "has ")) else ":"
    return InputError(f"{where}{colon} {text}", file=file, key=key, names=names)


def positive_value(text: str, like: str, key: str) -> float:
    """Return the SI value of a quantity given as text, which must be positive; see `si_value`."""
    value = si_value(text, like, key)
    if not value > 0:
        raise key_error(key, f"{text!r} must be positive")
    return value


def non_negative_value(text: str, like: str, key: str, *, difference: bool = False) -> float:
    """Return the SI value of a quantity given as text, which must be 0 or more; see `si_value`."""
    value = si_value(text, like, key, difference=difference)
    if value < 0:
        raise key_error(key, f"{text!r} is negative; give 0 or more")
    return value


def si_value(text: str, like: str, key: str, *, difference: bool = False) -> float:
    """Return the SI value of a quantity given as text; an error names `key`.

    A `difference` of temperatures may be in °C: "0.2 °C" is then 0.2 K.

    Raises
    ------
    InputError
        `parse_quantity` rejects the text, or it has an uncertainty, on which no result depends.
    """
    with error_location(key, key=key):
        quantity = parse_quantity(text, like, difference=difference)
    if quantity.sd:
        raise key_error(key, f"no result depends on the uncertainty in {text!r}; remove it")
    return quantity.value


def measured_constant(text: str, like: str, key: str, *, last_digit: bool = True) -> Measured:
    """Return the SI value and uncertainty of a constant given as text; an error names `key`.

    Without "±", the uncertainty is that of the last digit if `last_digit` is true.
    """
    with error_location(key, key=key):
        return parse_quantity(text, like, last_digit=last_digit)


def section_constant(section: BenchSection, name: str, like: str) -> Measured:
    """Return the SI value and uncertainty of a constant stated in the section."""
    return measured_constant(getattr(section, name), like, f"[bench] {name}")


def section_length(section: BenchSection, name: str) -> Measured:
    """Return a measured length, m, which must be positive and larger than its uncertainty."""
    length, key, text = (
        section_constant(section, name, "m"),
        f"[bench] {name}",
        getattr(section, name),
    )
    if length.value <= 0:
        raise key_error(key, f"{text!r} must be positive")
    if length.sd >= length.value:
        raise key_error(key, f"the uncertainty in {text!r} is larger than the length itself")
    return length


_LARGEST_PLAIN = 1e-3  # a larger deviation without a unit may be meant in %


def section_deviation(
    section: BenchSection, name: str, like: str, limit: Limit | None = None
) -> float:
    """Return a standard deviation stated in the section, SI."""
    key, text = f"[bench] {name}", getattr(section, name)
    value = non_negative_value(text, like, key)
    if like == "1" and value > (_LARGEST_PLAIN if str(text).strip()[-1:].isdigit() else 1):
        raise key_error(key, f"{text!r} is {100 * value:g} %; state its unit, such as ppm or %")
    if limit is not None and value > limit.value:
        raise key_error(key, f"{text!r} is more than {limit.meaning}; check the value and its unit")
    return value


def section_harmonics(section: BenchSection, name: str) -> tuple[float, ...]:
    """Return several standard deviations, rad, which must be small angles."""
    key, texts = f"[bench] {name}", getattr(section, name)
    values = tuple(si_value(text, "°", key) for text in texts)
    if not all(0 <= sd <= SMALL_ANGLE.value for sd in values):
        raise key_error(key, f"{', '.join(texts)}: give each from 0 to 1°")
    return values


def section_gravity(section: BenchSection) -> Measured:
    """Return gravity as stated, or computed from latitude and height."""
    if section.gravity is None:
        if section.latitude is None:
            return gravity_at_unknown_height(_MIDDLE_LATITUDE)  # nothing depends on it
        latitude = measured_constant(section.latitude, "°", "[bench] latitude")
        if section.height is None:
            return gravity_at_unknown_height(latitude.value)
        return normal_gravity(latitude.value, si_value(section.height, "m", "[bench] height"))
    gravity = measured_constant(section.gravity, "m/s²", "[bench] gravity")
    low, high = _EARTH_GRAVITY
    if not low <= gravity.value <= high:
        raise key_error(
            "[bench] gravity",
            f"{section.gravity!r} is not possible; give gravity on Earth, {low} to {high} m/s²",
        )
    if gravity.sd > _GRAVITY_RANGE:
        raise key_error(
            "[bench] gravity",
            f"the uncertainty in {section.gravity!r} exceeds the variation of gravity on Earth, "
            f"{_GRAVITY_RANGE} m/s²; give a smaller one, or latitude instead",
        )
    return gravity

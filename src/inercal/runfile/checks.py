"""What the sections of a run file must say together, bench by bench and method by method."""

from collections.abc import Mapping, Sequence
from typing import Any

from inercal.benches import Bench, Centrifuge, DividingHead, Hand, RateTable, Turntable
from inercal.benches.kinds import named
from inercal.errors import InputError
from inercal.estimate import Gaussian
from inercal.methods import METHODS, Method
from inercal.plan import Step, Turn
from inercal.runfile.schema import ReadoutSection, RunSchema
from inercal.settings import Use

_NEEDED: Mapping[type, Mapping[str, str]] = {  # columns in [data] that a bench does not do without
    Centrifuge: {"arm_rate": "the column of the arm's rate (and arm_rate_unit)"},
    DividingHead: {"angle": "the column of the head's angle (and angle_unit)"},
    RateTable: {
        "arm_rate": "the column of the table's rate (and arm_rate_unit)",
        "mounting": 'the column of mountings, such as "XY" or "ZY 30"',
    },
}
_OWN: Mapping[str, tuple[type, ...]] = {  # keys of [data] that belong to some kinds of bench
    "arm_rate": (Centrifuge, RateTable),
    "attitude": (Centrifuge,),
    "mounting": (RateTable,),
    "angle": (DividingHead,),
    "autocollimator": (DividingHead,),
    "level": (DividingHead,),
    "table": (Turntable,),
    "table_file": (Turntable,),
    "hold": (Turntable,),
    "accept_moving": (Hand, DividingHead),
}
_TRIAD = ("x", "y", "z")


def require_once(priors: Sequence[Gaussian]) -> None:
    """Refuse a coefficient that two sources tell: they may be one and the same.

    Raises
    ------
    InputError
        Naming it.
    """
    names = [name for prior in priors for name in prior.names]
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if twice:
        raise InputError(
            f"[method] {', '.join(twice)}: given by several of prior, prior_file and prior_from; "
            "keep one source of each coefficient"
        )


def axes_of(columns: tuple[str | int, ...], bench: Bench) -> int | None:
    """Return how many accelerometers stand on a dividing head; None is a triad, elsewhere.

    Raises
    ------
    InputError
        Another number of columns than the bench takes.
    """
    n, key = len(columns), "[data] accelerometer"
    if isinstance(bench, DividingHead):
        if n not in (1, 2):
            raise InputError(
                f"{key}: name the columns of the one or two accelerometers on the head, such as "
                f'["a", "b"]; there are {n}: {", ".join(map(str, columns))}'
            )
        return n
    if n != len(_TRIAD):
        raise InputError(f"{key}: {n} columns; name three, of {', '.join(_TRIAD)}")
    return None


def require_columns(schema: RunSchema, bench: Bench) -> None:
    """Refuse columns that belong to another bench, and a bench without the columns it needs.

    Raises
    ------
    InputError
        Naming the key.
    """
    data, kind = schema.data, type(bench)
    for key, owners in _OWN.items():
        if getattr(data, key) is not None and kind not in owners:
            kinds = " or ".join(f'"{named(owner)}"' for owner in owners)
            raise InputError(f"[data] {key} goes with [bench] kind = {kinds}")
    for key, what in _NEEDED.get(kind, {}).items():
        if getattr(data, key) is None:
            raise InputError(f"[data] {key} is missing: name {what}")
    if isinstance(bench, Turntable) and len(data.table or bench.names) != len(bench.names):
        raise InputError(
            f"[data] table: name the column of each axis, {', '.join(bench.names)}; there are "
            f"{len(data.table or ())}"
        )


def require_used(schema: RunSchema, chosen: Method[Any, Any], steps: Sequence[Step]) -> None:
    """Refuse keys of [bench] and [sensor] that change nothing in what the method finds.

    Parameters
    ----------
    schema : RunSchema
    chosen : Method
    steps : sequence of Step
        Of the method's plan, as far as it has one before the data.

    Raises
    ------
    InputError
        Naming the key and the reason.
    """
    use = Use(
        method=chosen.name,
        turns=any(isinstance(step, Turn) for step in steps),
        attitudes=not chosen.free,
        gyros="w" in chosen.finds and schema.sensor.gyro is not None,
        means=schema.data.kind == "means",
    )
    for key, reason in schema.bench.idle(use).items():
        if key in schema.bench.model_fields_set:
            raise InputError(f"[bench] {key}: {reason}; leave it out")
    for kind in ("accelerometer", "gyro"):
        section: ReadoutSection | None = getattr(schema.sensor, kind)
        if section is None:
            continue
        for key, reason in section.idle(use).items():
            if key in section.model_fields_set:
                raise InputError(f"[sensor.{kind}] {key}: {reason}")


def require_frame(frame: str, chosen: Method[Any, Any], estimator: str) -> None:
    """Refuse a frame that the user states where the estimator has its own.

    Raises
    ------
    InputError
        Naming the estimators that take one.
    """
    if frame == "mount" or estimator in chosen.framed:
        return
    possible = "; ".join(
        f"{' and '.join(one.framed)} of {one.name}" for one in METHODS.values() if one.framed
    )
    raise InputError(
        f"[sensor] frame {frame!r} is for estimators that see norms alone, {possible}; leave it "
        f"out with {estimator} of {chosen.name}"
    )

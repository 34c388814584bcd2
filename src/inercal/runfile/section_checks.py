"""What the sections of a run file must say together, bench by bench and method by method."""

from collections.abc import Sequence
from typing import Any

from inercal.errors import InputError
from inercal.estimate import Gaussian
from inercal.methods import METHODS, Method
from inercal.plan import Step, Turn
from inercal.runfile.schema import ReadoutSection, RunSchema
from inercal.section_settings import BenchUsage


def require_distinct_priors(priors: Sequence[Gaussian]) -> None:
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


def require_used_keys(schema: RunSchema, chosen: Method[Any, Any], steps: Sequence[Step]) -> None:
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
    use = BenchUsage(
        method=chosen.name,
        turns=any(isinstance(step, Turn) for step in steps),
        attitudes=not chosen.unknown_attitudes,
        gyros="w" in chosen.default_coefficients and schema.sensor.gyro is not None,
        means=schema.data.kind == "means",
    )
    for key, reason in schema.bench.unused_keys(use).items():
        if key in schema.bench.model_fields_set:
            raise InputError(f"[bench] {key}: {reason}; leave it out")
    for kind in ("accelerometer", "gyro"):
        section: ReadoutSection | None = getattr(schema.sensor, kind)
        if section is None:
            continue
        for key, reason in section.unused_keys(use).items():
            if key in section.model_fields_set:
                raise InputError(f"[sensor.{kind}] {key}: {reason}")


def require_frame(frame: str, chosen: Method[Any, Any], estimator: str) -> None:
    """Refuse a frame that the user states where the estimator has its own.

    Raises
    ------
    InputError
        Naming the estimators that take one.
    """
    if frame == "mount" or estimator in chosen.norm_only_estimators:
        return
    possible = "; ".join(
        f"{' and '.join(one.norm_only_estimators)} of {one.name}"
        for one in METHODS.values()
        if one.norm_only_estimators
    )
    raise InputError(
        f"[sensor] frame {frame!r} is for estimators that use only norms, {possible}; leave it "
        f"out with {estimator} of {chosen.name}"
    )

"""What the result says and what it does not know, in plain words, computed from the numbers."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from inercal.estimate import Estimate
from inercal.parameters import Parameter
from inercal.recording import Finding
from inercal.sensors import Sensor
from inercal.units import digits

_LEAST = 1e-99  # probability that is still told
NOTHING: Mapping[str, Parameter] = MappingProxyType({})
COVERAGE = 2.0  # U = k u; about 95 % for the degrees of freedom met here


def verdict(
    estimate: Estimate,
    sensor: Sensor,
    findings: Sequence[Finding],
    estimator: str,
    expected: Mapping[str, Parameter] = NOTHING,
    sought: str = "position or turn",
) -> tuple[str, ...]:
    """Return lines; the first is the summary.

    Parameters
    ----------
    estimate : Estimate
        Without a trial axis.
    sensor : Sensor
    findings : sequence of Finding
    estimator : str
    expected : mapping of str to Parameter, optional
        The bench's parameters by full name, as they were stated.
    sought : str
        What may stick out where the data do not agree.
    """
    p = len(sensor.coefficients)
    lines: list[str] = []
    if estimate.groups:
        lines += _by_group(estimate, p)
    elif not estimate.dof:
        lines.append(
            f"{p} coefficients found; this estimator makes no test of how well the data agree"
        )
    elif estimate.consistent:
        lines.append(
            f"{p} coefficients found; the data agree with the stated noise and bench "
            f"(χ² = {estimate.chi2:.1f} with {estimate.dof} degrees of freedom, "
            f"p = {float(estimate.p_value):.2f})"
        )
    else:
        lines.append(
            f"{p} coefficients found, but the residuals are larger than noise and bench allow "
            f"(χ² = {estimate.chi2:.1f} with {estimate.dof} degrees of freedom, "
            f"p {chance(float(estimate.p_value))}): all uncertainties are scaled by "
            f"{float(estimate.birge):.2f}; look for the {sought} that sticks out among the "
            f"residuals and the bench's errors{_largest(estimate, expected)}"
        )
    if estimate.dof or estimate.groups:
        lines += _leading(estimate, sensor)
    lines += [
        f"{name} comes out at {1 + value:.3g} times nominal: the axis is reversed or the nominal "
        "scale is wrong"
        for name, value in zip(sensor.coefficients, estimate.value[:p], strict=True)
        if name.partition(".")[2] in ("k1", "scale") and not 0.5 < 1 + value < 2
    ]
    lines += estimate.notes
    lines += [f.message for f in findings if f.severity == "warning"]
    return tuple(lines)


def _largest(estimate: Estimate, expected: Mapping[str, Parameter]) -> str:
    """Name the largest residual, and what of the bench is farthest from what was stated."""
    told: list[str] = []
    if estimate.observations:
        worst = int(np.argmax(np.abs(estimate.whitened)))
        part, _, row = estimate.observations[worst].rstrip("]").partition("[")
        size = digits(0.0, abs(float(estimate.whitened[worst])))[1]
        told.append(f"{f'{row} {part}'.strip()}, {size} standard deviations")
    pulls = {
        name: abs(float(value - expected[name].value)) / expected[name].sd
        for name, value in zip(estimate.names, estimate.value, strict=True)
        if name in expected and expected[name].sd > 0
    }
    if pulls:
        name = max(pulls, key=lambda one: pulls[one])
        short, _, place = name.rstrip("]").partition("[")
        named = f"{short} of {place}" if place else short
        size = digits(0.0, pulls[name])[1]
        told.append(f"{named} is {size} standard deviations from what was stated")
    return f" (largest: {'; '.join(told)})" if told else ""


def _by_group(estimate: Estimate, count: int) -> list[str]:
    """Say how each kind of observations agrees with its noise."""
    told = [
        f"{group.name} χ² = {group.chi2:.1f} with {group.dof}, p {chance(group.p_value)}"
        for group in estimate.groups
    ]
    beyond = [group for group in estimate.groups if group.spread.excess]
    within = [group for group in estimate.groups if group.spread.share < 1]
    lines: list[str] = []
    if within:
        shares = ", ".join(f"{group.spread.share:.2g} for {group.name}" for group in within)
        lines.append(
            "some observations agree better than the scatter within rests says, as where a hand "
            f"trembles; of its variance a share counts: {shares}"
        )
    if not beyond:
        tested = all(group.dof > 0 for group in estimate.groups)
        first = f"{count} coefficients found; " + (
            "the data agree with their noise" if tested else "what there is to test agrees"
        )
        return [f"{first} ({'; '.join(told)})", *lines]
    added = ", ".join(f"{group.spread.excess:.2g} {group.unit} of {group.name}" for group in beyond)
    return [
        f"{count} coefficients found, but the residuals are larger than their noise "
        f"({'; '.join(told)}): a scatter of {added} is added to it, and so to all uncertainties",
        *lines,
    ]


def chance(p: float) -> str:
    """Return a small probability behind a "p": "= 0.003", "< 1e-99"."""
    return f"= {p:.1g}" if p > _LEAST else f"< {_LEAST:.0e}"


def _leading(estimate: Estimate, sensor: Sensor) -> list[str]:
    """Name the least known coefficient of each group and unit."""
    p = len(sensor.coefficients)
    measures = {axis.name: axis.measures for axis in sensor.axes}
    groups: dict[tuple[str, str], list[int]] = {}
    for k, name in enumerate(sensor.coefficients):
        kind = "accelerometer" if measures[name.partition(".")[0]] == "f" else "gyro"
        line = sensor.coefficient(name)
        groups.setdefault((f"{kind} {line.group}", line.unit), []).append(k)
    std = estimate.std[:p]
    parts: list[str] = []
    for (group, _), members in groups.items():
        worst = max(members, key=lambda k: float(std[k]))
        line = sensor.coefficient(sensor.coefficients[worst])
        size = digits(0.0, COVERAGE * float(std[worst]) / line.si)[1]
        parts.append(f"{group} {size} {line.unit}")
    return ["expanded uncertainties (k = 2) are at most: " + ", ".join(parts)]

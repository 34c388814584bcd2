"""Judge the claims of a source by the computed numbers.

A claim consists of its statement, its place in the source and the number that it requires. This is
a printed number, a number implied by the source's words, or the result of a printed formula or
figure. A finding adds the computed number and its uncertainty. The verdict follows from

    z = |expected − computed| / u,    one-sided if the claim is a bound

where u is the standard uncertainty of the comparison: rounding of the printed digits, Monte Carlo
error, the noise of the experiment, or the remaining error of the corrected formula.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import ceil, floor, hypot, inf, isfinite, log10, sqrt
from typing import Literal, NamedTuple

import numpy as np

from inercal.basics.arrays import Array

Relation = Literal["=", "≤", "≥"]
Basis = Literal["number", "words", "derived"]
Verdict = Literal["reproduced", "not reproducible", "false"]
_BASIS_PHRASES = {
    "number": "In print",
    "words": "Its words mean",
    "derived": "The printed formula gives",
}
LIMIT = 2.0  # standard uncertainties, about 95 %, as for all expanded uncertainties here


@dataclass(frozen=True)
class Claim:
    """One claim from a source.

    Parameters
    ----------
    name : str
        The statement as text.
    where : str
        Equation, table or section.
    expected : float
        The number that the claim requires.
    unit : str
    relation : "=", "≤" or "≥"
        Relation of the quantity to the expected number.
    kind : "result" or "statement"
        A result is the outcome of one run, which may not be reproducible. A statement is false if
        the numbers contradict it.
    last_digit : float
        Value of one unit in the last printed digit; 0 for an exact number.
    basis : "number", "words" or "derived"
        Whether the source prints the number, implies it in words, or prints a formula for it.
    """

    name: str
    where: str
    expected: float
    unit: str = ""
    relation: Relation = "="
    kind: Literal["result", "statement"] = "statement"
    last_digit: float = 0.0
    basis: Basis = "number"

    @property
    def printed(self) -> float | None:
        """Return the printed number, or None if the source prints none."""
        return self.expected if self.basis == "number" else None

    @property
    def title(self) -> str:
        """Return the place and the statement, such as "Table 2: S_ax"."""
        return f"{self.where}: {self.name}"

    @property
    def digits(self) -> int:
        """Return the number of significant digits in print, or four if no number is printed."""
        if not (self.last_digit and self.expected):
            return 4
        return floor(log10(abs(self.expected) / self.last_digit) + 1 + 1e-9)

    @property
    def rounding(self) -> float:
        """Return the standard uncertainty from rounding in print: half a unit over √3."""
        return self.last_digit / 2 / sqrt(3)


@dataclass(frozen=True)
class ClaimResult:
    """A claim with the computed number, from which the verdict follows.

    Parameters
    ----------
    claim : Claim
    computed : float
        Computed number in the claim's unit; not finite if there is no result.
    uncertainty : float
        Standard uncertainty of the comparison, including rounding.
    reason : str
        Reason for the result, with numbers.
    """

    claim: Claim
    computed: float
    uncertainty: float
    reason: str

    @property
    def deviation(self) -> float:
        """Return the deviation from the claim in standard uncertainties; 0 within a bound."""
        return normalized_deviation(
            self.claim.expected, self.computed, self.uncertainty, self.claim.relation
        )

    @property
    def verdict(self) -> Verdict:
        """Return the verdict that follows from the numbers."""
        if self.deviation <= LIMIT:
            return "reproduced"
        return "not reproducible" if self.claim.kind == "result" else "false"

    @property
    def explanation(self) -> str:
        """Return a sentence that explains the verdict, with the computed numbers."""
        unit = f" {self.claim.unit}" if self.claim.unit else ""
        claimed = f"{_BASIS_PHRASES[self.claim.basis]} {self.expected_text}{unit}"
        if not isfinite(self.computed):
            return f"{claimed}; there is no result: {self.reason}."
        text = f"{claimed}, computed {self.computed_text}{unit}"
        if self.deviation == 0 and self.claim.relation != "=":
            text += ", as claimed"
        elif self.uncertainty > 0:
            apart = "more than 1000" if self.deviation > 1000 else shown(self.deviation)
            text += f", {apart} u apart" if self.deviation > LIMIT else f", within {shown(LIMIT)} u"
        return f"{text}: {self.reason}."

    @property
    def printed_text(self) -> str:
        """Return the printed number as text, with its relation, or a dash if there is none."""
        return "—" if self.claim.printed is None else self.expected_text

    @property
    def expected_text(self) -> str:
        """Return the number that the claim requires, as text with its relation."""
        relation = "" if self.claim.relation == "=" else f"{self.claim.relation} "
        return relation + shown(self.claim.expected, self.claim.digits)

    @property
    def computed_text(self) -> str:
        """Return the computed number as text, rounded to its uncertainty or to seven digits."""
        digits = 4
        if isfinite(self.computed) and self.computed and 0 < self.uncertainty < inf:
            digits = 2 + max(ceil(log10(abs(self.computed) / self.uncertainty)), 0)
        return shown(self.computed, min(digits, max(self.claim.digits, 3)))


def normalized_deviation(
    expected: float, computed: float, uncertainty: float, relation: Relation
) -> float:
    """Return |expected − computed| / u, or 0 if the relation is satisfied.

    Examples
    --------
    >>> normalized_deviation(1.0, 1.3, 0.1, "≥")
    0.0
    >>> normalized_deviation(1.0, 1.0, 0.0, "=")
    0.0
    >>> normalized_deviation(1.0, float("nan"), 0.1, "=")
    inf
    """
    if not isfinite(computed):
        return inf
    miss = computed - expected
    if (relation == "≤" and miss <= 0) or (relation == "≥" and miss >= 0) or miss == 0:
        return 0.0
    return abs(miss) / uncertainty if uncertainty > 0 else inf


def judge_claim(claim: Claim, computed: float, uncertainty: float, reason: str) -> ClaimResult:
    """Return the finding, after adding the rounding of the printed digits to the uncertainty."""
    return ClaimResult(claim, float(computed), hypot(uncertainty, claim.rounding), reason)


# Numbers in this range are written without a power of ten.
_PLAIN_MIN, _PLAIN_MAX, _PLAIN_DIGITS = 1e-2, 1e4, 9
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def shown(x: float, digits: int = 2) -> str:
    """Format a number with a given number of significant digits.

    Examples
    --------
    >>> [shown(x) for x in (-3.14159e-7, 21.0, 1234.5, 22634.0, 1e-8)]
    ['−3.1·10⁻⁷', '21', '1200', '2.3·10⁴', '10⁻⁸']
    """
    if not isfinite(x):
        return "none" if x != inf else "infinitely many"
    mantissa, _, power = f"{x:.{digits}g}".partition("e")
    if 1 <= abs(x) < _PLAIN_MAX:
        mantissa, power = f"{float(f'{x:.{digits}g}'):.{_PLAIN_DIGITS}g}", ""
    elif not power and 0 < abs(x) < _PLAIN_MIN:
        mantissa, _, power = f"{x:.{digits - 1}e}".partition("e")
    if "." in mantissa and power:
        mantissa = mantissa.rstrip("0").rstrip(".")
    if power:
        tens = f"10{str(int(power)).translate(_SUPERSCRIPTS)}"
        mantissa = {"1": tens, "-1": f"-{tens}"}.get(mantissa, f"{mantissa}·{tens}")
    return mantissa.replace("-", "−")


class Rms(NamedTuple):
    """A root mean square, or a mean, with its Monte Carlo error."""

    value: float
    u: float


def format_all(values: Iterable[float | Rms], digits: int = 2) -> list[str]:
    """Format numbers with `shown`; means are given without their errors."""
    return [shown(x.value if isinstance(x, Rms) else x, digits) for x in values]


def rms(errors: Array, ddof: int = 0) -> Rms:
    """Return the RMS of errors, (trials, ...), which may be correlated within a trial."""
    square = np.mean(errors.reshape(len(errors), -1) ** 2, axis=1)
    value = float(np.sqrt(square.mean()))
    spread = square.std(ddof=ddof) / np.sqrt(len(square))
    return Rms(value, float(spread / (2 * value)) if value else 0.0)

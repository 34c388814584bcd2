"""What a source says, and the verdict on it from the numbers.

A claim is data: what is said, where, and the number in print. A finding puts beside it the number
that comes out, and how well that is known. The verdict follows from

    z = |printed − computed| / u,    one-sided where the claim is a bound

u the standard uncertainty of the comparison: rounding of the printed digits, Monte Carlo error, the
noise of the experiment, or what the mended formula itself leaves.
"""

from dataclasses import dataclass
from math import ceil, floor, hypot, inf, isfinite, log10, sqrt
from typing import Literal

Relation = Literal["=", "≤", "≥"]
Verdict = Literal["reproduced", "not reproducible", "false"]
LIMIT = 2.0  # standard uncertainties, about 95 %, as of every expanded uncertainty here


@dataclass(frozen=True)
class Claim:
    """One thing that a source says.

    Parameters
    ----------
    name : str
        What is said, in words.
    where : str
        Equation, table or section.
    printed : float
        The number in print; of a formula, what it gives as printed.
    unit : str
    relation : "=", "≤" or "≥"
        Of the quantity to the printed number.
    kind : "result" or "statement"
        The outcome of one run, which may fail to come out again; or a statement, which is false
        where it fails.
    last_digit : float
        Value of one unit in the last printed place; 0 is exact.
    """

    name: str
    where: str
    printed: float
    unit: str = ""
    relation: Relation = "="
    kind: Literal["result", "statement"] = "statement"
    last_digit: float = 0.0

    @property
    def title(self) -> str:
        """Where and what: "Table 2: S_ax"."""
        return f"{self.where}: {self.name}"

    @property
    def digits(self) -> int:
        """Significant digits in print; four of what was not printed as a number."""
        if not (self.last_digit and self.printed):
            return 4
        return floor(log10(abs(self.printed) / self.last_digit) + 1 + 1e-9)

    @property
    def rounding(self) -> float:
        """Standard uncertainty by the rounding of the printed digits: half a unit over √3."""
        return self.last_digit / 2 / sqrt(3)


@dataclass(frozen=True)
class Finding:
    """A claim beside what comes out; the verdict is computed, never stated.

    Parameters
    ----------
    claim : Claim
    computed : float
        In the claim's unit; not finite where nothing comes out.
    uncertainty : float
        Standard uncertainty of the comparison, rounding included.
    because : str
        The reason in words, with its figures.
    """

    claim: Claim
    computed: float
    uncertainty: float
    because: str

    @property
    def off(self) -> float:
        """How far the claim is missed, in standard uncertainties; 0 within a bound."""
        return distance(self.claim.printed, self.computed, self.uncertainty, self.claim.relation)

    @property
    def verdict(self) -> Verdict:
        """The verdict by the numbers."""
        if self.off <= LIMIT:
            return "reproduced"
        return "not reproducible" if self.claim.kind == "result" else "false"

    @property
    def why(self) -> str:
        """The verdict's sentence, with the computed figures."""
        unit = f" {self.claim.unit}" if self.claim.unit else ""
        if not isfinite(self.computed):
            return f"In print {self.in_print}{unit}; nothing comes out: {self.because}."
        text = f"In print {self.in_print}{unit}, computed {self.came_out}{unit}"
        if self.off == 0 and self.claim.relation != "=":
            text += ", as claimed"
        elif self.uncertainty > 0:
            apart = "more than 1000" if self.off > 1000 else shown(self.off)
            text += f", {apart} u apart" if self.off > LIMIT else f", within {shown(LIMIT)} u"
        return f"{text}: {self.because}."

    @property
    def in_print(self) -> str:
        """The printed number as text, with its relation."""
        relation = "" if self.claim.relation == "=" else f"{self.claim.relation} "
        return relation + shown(self.claim.printed, self.claim.digits)

    @property
    def came_out(self) -> str:
        """The computed number as text: to its uncertainty, and no further than seven digits."""
        digits = 4
        if isfinite(self.computed) and self.computed and 0 < self.uncertainty < inf:
            digits = 2 + max(ceil(log10(abs(self.computed) / self.uncertainty)), 0)
        return shown(self.computed, min(digits, max(self.claim.digits, 3)))


def distance(printed: float, computed: float, uncertainty: float, relation: Relation) -> float:
    """Return |printed − computed| in uncertainties, counted only against the relation.

    Examples
    --------
    >>> distance(1.0, 1.3, 0.1, "≥")
    0.0
    >>> distance(1.0, 1.0, 0.0, "=")
    0.0
    >>> distance(1.0, float("nan"), 0.1, "=")
    inf
    """
    if not isfinite(computed):
        return inf
    miss = computed - printed
    if (relation == "≤" and miss <= 0) or (relation == "≥" and miss >= 0) or miss == 0:
        return 0.0
    return abs(miss) / uncertainty if uncertainty > 0 else inf


def judge(claim: Claim, computed: float, uncertainty: float, because: str) -> Finding:
    """Return the finding, the rounding of the printed digits added to the uncertainty."""
    return Finding(claim, float(computed), hypot(uncertainty, claim.rounding), because)


_SHORT, _LONG, _LONGEST = 1e-2, 1e4, 9  # numbers between are written without a power of ten
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def shown(x: float, digits: int = 2) -> str:
    """Return a number as text with that many significant digits.

    Examples
    --------
    >>> shown(-3.14159e-7), shown(21.0), shown(1234.5), shown(22634.0), shown(1e-8)
    ('−3.1·10⁻⁷', '21', '1200', '2.3·10⁴', '10⁻⁸')
    """
    if not isfinite(x):
        return "none" if x != inf else "infinitely many"
    mantissa, _, power = f"{x:.{digits}g}".partition("e")
    if 1 <= abs(x) < _LONG:
        mantissa, power = f"{float(f'{x:.{digits}g}'):.{_LONGEST}g}", ""
    elif not power and 0 < abs(x) < _SHORT:
        mantissa, _, power = f"{x:.{digits - 1}e}".partition("e")
    if "." in mantissa and power:
        mantissa = mantissa.rstrip("0").rstrip(".")
    if power:
        tens = f"10{str(int(power)).translate(_RAISED)}"
        mantissa = {"1": tens, "-1": f"-{tens}"}.get(mantissa, f"{mantissa}·{tens}")
    return mantissa.replace("-", "−")

"""Two calibrations compared, coefficient by coefficient and all together."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from inercal.arrays import Array
from inercal.calibration import Calibration
from inercal.errors import InputError
from inercal.store import changes
from inercal.store.comparability import fixed_coefficients, match_frame_and_form, recording_sha256


@dataclass(frozen=True, eq=False)
class Comparison:
    """A later calibration beyond an earlier one, in the same terms.

    Parameters
    ----------
    first, second : Calibration
    names : tuple of str
        Coefficients that both have, with an uncertainty.
    exclusions : tuple of str
        In words: coefficients that only one has, or that no data stand behind.
    """

    first: Calibration
    second: Calibration
    names: tuple[str, ...]
    exclusions: tuple[str, ...]

    @cached_property
    def difference(self) -> Array:
        """Second minus first, SI, (p,)."""
        first, second = (np.array([one.value(n) for n in self.names]) for one in self._both)
        return second - first

    @cached_property
    def std(self) -> tuple[Array, Array]:
        """Standard uncertainties (k = 1) of first and second, SI, (p,) each."""
        first, second = (np.array([one.uncertainty(n) for n in self.names]) for one in self._both)
        return first, second

    @cached_property
    def normalised_errors(self) -> Array:
        """E_n, (p,)."""
        return changes.normalised_errors(self.difference, *self.std)

    @cached_property
    def joint_test(self) -> changes.JointTest | None:
        """All coefficients together; None where none is in common."""
        if not self.names:
            return None
        total = np.zeros((len(self.names), len(self.names)))
        for one in self._both:
            place = {name: k for k, name in enumerate(one.sensor.coefficients)}
            picks = [place[name] for name in self.names]
            total += one.covariance[np.ix_(picks, picks)]
        return changes.joint_test(self.difference, total)

    @property
    def same_recording(self) -> bool:
        """Whether both are of the same recording: then they share its errors."""
        first, second = map(recording_sha256, self._both)
        return bool(first) and first == second

    @property
    def exceedances(self) -> int:
        """How many |E_n| exceed 1."""
        return int(np.sum(np.abs(self.normalised_errors) > 1))

    @property
    def expected_exceedances(self) -> float:
        """How many of them chance would give."""
        return changes.CHANCE_FRACTION * len(self.names)

    @property
    def _both(self) -> tuple[Calibration, Calibration]:
        return self.first, self.second


def compare(first: Calibration, second: Calibration) -> Comparison:
    """Return two calibrations compared in the terms of the second, else in those of the first.

    Raises
    ------
    InputError
        Neither can be brought to the terms of the other.
    """
    try:
        return build_comparison(match_frame_and_form(first, second), second)
    except InputError as error:
        try:
            return build_comparison(first, match_frame_and_form(second, first))
        except InputError:
            raise InputError(f"the first cannot be compared with the second: {error}") from None


def build_comparison(first: Calibration, second: Calibration) -> Comparison:
    """Return two calibrations in the same terms compared."""
    fixed = fixed_coefficients(first) | fixed_coefficients(second)
    mine, its = (one.sensor.coefficients for one in (first, second))
    names = tuple(name for name in its if name in mine and name not in fixed)
    left_out = [
        f"{words} {', '.join(found)}"
        for words, found in (
            ("no data stand behind", [n for n in its if n in fixed and n in mine]),
            ("only the first has", [n for n in mine if n not in its and n not in fixed]),
            ("only the second has", [n for n in its if n not in mine and n not in fixed]),
        )
        if found
    ]
    return Comparison(first, second, names, tuple(left_out))

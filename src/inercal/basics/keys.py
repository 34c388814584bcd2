"""Structured names for coefficients, bench errors and observations.

Each name is a string, written as in run files and calibration files, and it compares, hashes and
sorts like any string. Only this module splits these strings into parts.
"""

from typing import Self

PRIOR_OF = "prior of "  # start of the name of a coefficient's prior
_COMPONENTS = ("x", "y", "z", "1", "2")


class CoefficientName(str):
    """The name of a coefficient of an axis, "ax.k0"."""

    __slots__ = ()

    @classmethod
    def of(cls, axis: str, term: str) -> Self:
        """Return the name of a coefficient of an axis."""
        return cls(f"{axis}.{term}")

    @property
    def axis(self) -> str:
        """The axis; empty if the name contains no axis, as in "k0"."""
        return self.rpartition(".")[0]

    @property
    def term(self) -> str:
        """The name of the coefficient in its table, such as "k0", or the name of a group."""
        return self.rpartition(".")[2]

    @property
    def parts(self) -> tuple[str, str]:
        """Axis and term."""
        axis, _, term = self.rpartition(".")
        return axis, term


class ErrorName(str):
    """The name of a bench error: of the whole run, "radius", or at one place, "pose_x[XY30]".

    A place is a mounting, a position, a set speed, a turn or another scope from `Parameter`.
    """

    __slots__ = ()

    @classmethod
    def at(cls, name: str, place: str) -> Self:
        """Return the name of an error at a place."""
        return cls(f"{name}[{place}]")

    @property
    def name(self) -> str:
        """The name of the declared parameter, "pose_x"."""
        return self.partition("[")[0]

    @property
    def place(self) -> str:
        """The place, "XY30"; empty for an error that applies to the whole run."""
        return self.partition("[")[2].removesuffix("]")

    @property
    def parts(self) -> tuple[str, str]:
        """Name and place."""
        return self.name, self.place

    @property
    def vector(self) -> "ErrorName":
        """The vector of a component, "pose[XY30]" for "pose_x[XY30]"; otherwise the name."""
        stem, _, component = self.name.rpartition("_")
        split = stem and self.place and component in _COMPONENTS
        return ErrorName.at(stem, self.place) if split else self


class ObservationName(str):
    """The name of a row of observations, or of one channel in it, "ax[XY30 at 90 rpm]"."""

    __slots__ = ()

    @property
    def channel(self) -> str:
        """The channel, "ax"."""
        return self.partition("[")[0]

    @property
    def row(self) -> str:
        """The row, "XY30 at 90 rpm"; empty if the name has no channel."""
        return self.partition("[")[2].removesuffix("]")

"""Structured names: a coefficient of an axis, an error of the bench at a place, an observation.

Each is the text of run files and calibration files, and compares, hashes and sorts as such. Only
this module splits these texts.
"""

from typing import Self

_COMPONENTS = ("x", "y", "z", "1", "2")


class CoefficientName(str):
    """A coefficient of an axis, "ax.k0"."""

    __slots__ = ()

    @classmethod
    def of(cls, axis: str, term: str) -> Self:
        """Return the name of an axis's coefficient."""
        return cls(f"{axis}.{term}")

    @property
    def axis(self) -> str:
        """The axis; empty where the name has none, "k0"."""
        return self.rpartition(".")[0]

    @property
    def term(self) -> str:
        """The name of the coefficient in its table, "k0", or of a group."""
        return self.rpartition(".")[2]

    @property
    def parts(self) -> tuple[str, str]:
        """Axis and term."""
        axis, _, term = self.rpartition(".")
        return axis, term


class ErrorName(str):
    """An error of the bench: over the run, "radius", or at a place, "pose_x[XY30]".

    A place is a mounting, a position, a set speed, a turn or another scope of `Parameter`.
    """

    __slots__ = ()

    @classmethod
    def at(cls, name: str, place: str) -> Self:
        """Return the name of an error at a place."""
        return cls(f"{name}[{place}]")

    @property
    def name(self) -> str:
        """The declared parameter, "pose_x"."""
        return self.partition("[")[0]

    @property
    def place(self) -> str:
        """The place, "XY30"; empty for an error over the run."""
        return self.partition("[")[2].removesuffix("]")

    @property
    def parts(self) -> tuple[str, str]:
        """Name and place."""
        return self.name, self.place

    @property
    def vector(self) -> "ErrorName":
        """The vector of which it is a component, "pose[XY30]" for "pose_x[XY30]", or itself."""
        stem, _, component = self.name.rpartition("_")
        split = stem and self.place and component in _COMPONENTS
        return ErrorName.at(stem, self.place) if split else self


class ObservationName(str):
    """An observation of a channel in a row, "ax[XY30 at 90 rpm]", or of a complete row."""

    __slots__ = ()

    @property
    def channel(self) -> str:
        """The channel, "ax"."""
        return self.partition("[")[0]

    @property
    def row(self) -> str:
        """The row, "XY30 at 90 rpm"; empty without a channel."""
        return self.partition("[")[2].removesuffix("]")

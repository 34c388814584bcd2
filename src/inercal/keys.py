"""Structured names: a coefficient of an axis, an error of the bench somewhere, an observation.

Each is text: equal to, hashed, sorted and written as what a run file or a calibration file says.
Nothing else takes such text apart.
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
        """The coefficient's name in its table, "k0", or a group's."""
        return self.rpartition(".")[2]

    @property
    def parts(self) -> tuple[str, str]:
        """Axis and term."""
        return self.axis, self.term


class ErrorName(str):
    """An error of the bench: of the whole run, "radius", or of a place, "pose_x[XY30]".

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
        """Where it acts, "XY30"; empty of the whole run."""
        return self.partition("[")[2].removesuffix("]")

    @property
    def parts(self) -> tuple[str, str]:
        """Name and place."""
        return self.name, self.place

    @property
    def vector(self) -> "ErrorName":
        """The vector at a place that it is of, "pose[XY30]" of "pose_x[XY30]"; itself if none."""
        stem, _, component = self.name.rpartition("_")
        split = stem and self.place and component in _COMPONENTS
        return ErrorName.at(stem, self.place) if split else self


class ObservationName(str):
    """One observation: of a channel in a row, "ax[XY30 at 90 rpm]", or of a row as a whole."""

    __slots__ = ()

    @property
    def channel(self) -> str:
        """The channel, "ax"."""
        return self.partition("[")[0]

    @property
    def row(self) -> str:
        """The row, "XY30 at 90 rpm"; empty without a channel."""
        return self.partition("[")[2].removesuffix("]")

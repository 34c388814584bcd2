"""Register objects by name, from this package and, through entry points, from others.

A package registers an object with an entry point in the group, in its pyproject.toml::

    [project.entry-points."inercal.methods"]
    tilt_means = "their_package.tilt:METHOD"

The object is imported on first access. For a name in this package, the metadata of installed
packages are not read, because this takes about 20 ms.
"""

from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from importlib import import_module
from importlib.metadata import EntryPoint, distributions, entry_points
from typing import Any, TypeVar

from inercal.basics.errors import InputError

T = TypeVar("T")


class Registry(Mapping[str, T]):
    """Objects of one kind, by name; the names from this package come first.

    Parameters
    ----------
    group : str
        Group of entry points, such as "inercal.methods".
    what : str
        Word for such an object in messages, such as "method".
    own : mapping of str to str
        Objects in this package, as "module:attribute" by name.
    kind : type, optional
        Class of the objects; an object of another package that is none of them is refused.
    """

    def __init__(self, group: str, what: str, own: Mapping[str, str], kind: Any = object) -> None:
        self.group, self.what, self._own, self._kind = group, what, dict(own), kind
        self._loaded: dict[str, T] = {}
        self._added: dict[str, T] = {}

    def __getitem__(self, name: str) -> T:
        if name in self._added:
            return self._added[name]
        if name not in self._loaded:
            if name in self._own:
                module, _, attribute = self._own[name].partition(":")
                self._loaded[name] = getattr(import_module(module), attribute)
            elif name in self._foreign:
                self._loaded[name] = self._load(self._foreign[name])
            else:
                raise KeyError(name)
        return self._loaded[name]

    def __iter__(self) -> Iterator[str]:
        yield from self._own
        yield from self._foreign
        yield from self._added

    def __len__(self) -> int:
        return len(tuple(iter(self)))

    def __contains__(self, name: object) -> bool:
        return name in self._own or name in self._added or name in self._foreign

    def find(self, name: str) -> T:
        """Return the object with this name.

        Raises
        ------
        InputError
            The name is unknown (the message lists the known names), two packages register it, or
            the object cannot be imported.
        """
        if name not in self:
            from difflib import get_close_matches

            near = get_close_matches(name, tuple(self), n=1)
            hint = f"did you mean {near[0]}? " if near else ""
            raise InputError(
                f"no {self.what} {name!r}; {hint}{'T' if hint else 't'}here are {', '.join(self)}",
                names=(name,),
            )
        return self[name]

    def for_address(self, address: str, forms: Callable[[], str] | None = None) -> T:
        """Return the object that the scheme of an address names.

        Parameters
        ----------
        address : str
            Such as "pmac://10.0.0.5:1025"; its scheme is the text before the first colon.
        forms : callable, optional
            Function that returns the possible addresses, for the message.

        Raises
        ------
        InputError
            There is no such object; see also `find`.
        """
        scheme = address.partition(":")[0].lower()
        if scheme not in self:
            possible = forms() if forms else ", ".join(f"{name}:…" for name in self)
            one = f"{'an' if self.what[0] in 'aeiou' else 'a'} {self.what}"
            raise InputError(
                f"{address!r} is not an address of {one}; possible: "
                f"{possible or f'none, because no package that adds {one} is installed'}",
                names=(address,),
            )
        return self.find(scheme)

    @contextmanager
    def with_(self, name: str, one: T) -> Generator[None]:
        """Register an object during the block, as another package would do."""
        if name in self:
            raise InputError(
                f"a {self.what} {name!r} already exists; choose another name", names=(name,)
            )
        self._added[name] = one
        try:
            yield
        finally:
            del self._added[name]

    @cached_property
    def _foreign(self) -> Mapping[str, EntryPoint]:
        points: dict[str, EntryPoint] = {}
        texts = (one.read_text("entry_points.txt") or "" for one in distributions())
        if not any(self.group in text for text in texts):  # parsing all takes several times as long
            return points
        for point in entry_points(group=self.group):
            other = points.get(point.name)
            if point.name in self._own or (other is not None and other.value != point.value):
                taken = "inercal" if other is None else _distribution_name(other)
                raise InputError(
                    f"packages {_distribution_name(point)} and {taken} both have a {self.what} "
                    f"{point.name!r}; rename it, or uninstall one of them",
                    names=(point.name,),
                )
            points[point.name] = point
        return points

    def _load(self, point: EntryPoint) -> T:
        try:
            found = point.load()
            if not isinstance(found, self._kind):
                raise TypeError(f"it is a {type(found).__name__}, not a {self._kind.__name__}")
            return found
        except Exception as error:  # any error in the module of another package
            raise InputError(
                f"{self.what} {point.name!r} of package {_distribution_name(point)} cannot be "
                f"loaded from {point.value}: {error}; update or uninstall the package",
                names=(point.name,),
            ) from error


def _distribution_name(point: EntryPoint) -> str:
    return point.dist.name if point.dist is not None else point.value

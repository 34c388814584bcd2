"""Load names in a package when they are first used."""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def lazy_names(package: str, modules: Mapping[str, str]) -> Callable[[str], Any]:
    """Return a `__getattr__` function for a package.

    Parameters
    ----------
    package : str
        The `__name__` of the package.
    modules : mapping of str to str
        The module within the package that defines each name, such as "calibration.files".
    """

    def load(name: str) -> Any:
        if name not in modules:
            raise AttributeError(
                f"module {package!r} has no attribute {name!r}; it has {', '.join(modules)}"
            )
        return getattr(import_module(f"{package}.{modules[name]}"), name)

    return load

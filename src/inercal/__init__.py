"""Calibrates accelerometers and IMUs on the bench a laboratory has.

>>> import inercal
>>> inercal.calibrate  # doctest: +ELLIPSIS
<function calibrate at ...>

The names below are loaded when they are first used, so that the command line starts quickly.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from inercal.calibration import Calibration
    from inercal.calibration.files import load, save
    from inercal.demonstration import demo
    from inercal.pipeline import Outcome, apply, calibrate, simulate
    from inercal.report import write_report

_EXPORT_MODULES = {
    "Calibration": "inercal.calibration",
    "Outcome": "inercal.pipeline",
    "apply": "inercal.pipeline",
    "calibrate": "inercal.pipeline",
    "demo": "inercal.demonstration",
    "load": "inercal.calibration.files",
    "write_report": "inercal.report",
    "save": "inercal.calibration.files",
    "simulate": "inercal.pipeline",
}


def _is_writable(folder: str) -> bool:
    """Whether files can be made in a folder, or the folder itself where it is not there yet."""
    while not os.path.exists(folder) and os.path.dirname(folder) != folder:
        folder = os.path.dirname(folder)
    return os.access(folder, os.W_OK | os.X_OK)


def _provide_kernel_cache() -> Any:
    """Give numba a folder for this process where it finds none; it would refuse to start.

    It keeps compiled kernels beside their modules, or in the user's cache.
    """
    own = os.environ.get("XDG_CACHE_HOME") or os.path.join("~", ".cache")
    places = (os.path.dirname(__file__), os.path.expanduser(own))
    if "NUMBA_CACHE_DIR" in os.environ or any(map(_is_writable, places)):
        return None
    from tempfile import TemporaryDirectory

    folder = TemporaryDirectory(prefix="inercal-")  # removed when the process ends
    os.environ["NUMBA_CACHE_DIR"] = folder.name
    return folder


_kernels = _provide_kernel_cache()


def __getattr__(name: str) -> Any:
    if name not in _EXPORT_MODULES:
        raise AttributeError(
            f"module 'inercal' has no attribute {name!r}; it has {', '.join(_EXPORT_MODULES)}"
        )
    return getattr(import_module(_EXPORT_MODULES[name]), name)


__all__ = [
    "Calibration",
    "Outcome",
    "apply",
    "calibrate",
    "demo",
    "load",
    "save",
    "simulate",
    "write_report",
]

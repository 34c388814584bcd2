"""Calibrates accelerometers and IMUs on the bench a laboratory has.

>>> import inercal
>>> inercal.calibrate  # doctest: +ELLIPSIS
<function calibrate at ...>

The names below are loaded when they are first used, so that the command line starts quickly.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from inercal.kernel_cache import prepare_kernel_cache

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


_kernel_folder = prepare_kernel_cache()  # removed when the process ends


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

"""Calibrates accelerometers and IMUs on the bench a laboratory has.

- `calibrate`: an `Outcome` from a run file, or from data in memory with sensor, bench and method;
- `calibrate_batch`: the coefficients of many sensors of one type, from their means;
- `write_report`, `plot_residuals`, `plot_coverage`: what the outcome shows;
- `save`, `load`: its `Calibration` as a file, which also has `correct`, `to_dataframe`, `to_latex`;
- `apply`: a recording corrected by a calibration;
- `export_calibration`, `import_calibration`: files of other programs, written and read;
- `analyse_noise`: white noise, bias instability and random walk of a recording at rest;
- `simulate`, `demo`: the same on simulated benches.

>>> import inercal
>>> inercal.calibrate  # doctest: +ELLIPSIS
<function calibrate at ...>

The names below are loaded when they are first used, so that the command line starts quickly.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from inercal.basics.kernel_cache import prepare_kernel_cache

if TYPE_CHECKING:
    from inercal.calibration import Calibration
    from inercal.calibration.files import load, save
    from inercal.export import export_calibration
    from inercal.export.readers import import_calibration
    from inercal.host.demonstration import demo
    from inercal.noise import analyse_noise
    from inercal.pipeline import Outcome, apply, calibrate, simulate
    from inercal.pipeline.batch import calibrate_batch
    from inercal.report import plot_coverage, plot_residuals, write_report

_EXPORT_MODULES = {
    "Calibration": "inercal.calibration",
    "Outcome": "inercal.pipeline",
    "analyse_noise": "inercal.noise",
    "apply": "inercal.pipeline",
    "calibrate": "inercal.pipeline",
    "calibrate_batch": "inercal.pipeline.batch",
    "demo": "inercal.host.demonstration",
    "export_calibration": "inercal.export",
    "import_calibration": "inercal.export.readers",
    "load": "inercal.calibration.files",
    "plot_coverage": "inercal.report",
    "plot_residuals": "inercal.report",
    "write_report": "inercal.report",
    "save": "inercal.calibration.files",
    "simulate": "inercal.pipeline",
}


_kernel_folder = prepare_kernel_cache()  # removed when the process ends


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("inercal")
    if name not in _EXPORT_MODULES:
        raise AttributeError(
            f"module 'inercal' has no attribute {name!r}; it has {', '.join(_EXPORT_MODULES)}"
        )
    return getattr(import_module(_EXPORT_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted([*_EXPORT_MODULES, "__doc__", "__version__"])


__all__ = [
    "Calibration",
    "Outcome",
    "analyse_noise",
    "apply",
    "calibrate",
    "calibrate_batch",
    "demo",
    "export_calibration",
    "import_calibration",
    "load",
    "plot_coverage",
    "plot_residuals",
    "save",
    "simulate",
    "write_report",
]

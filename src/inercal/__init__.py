"""Calibration of accelerometers and IMUs on the bench that a laboratory has.

- `calibrate`: compute an `Outcome` from a run file, or from data in memory;
- `calibrate_batch`: estimate the coefficients of many sensors of one type from their means;
- `write_report`, `plot_residuals`, `plot_coverage`: show the outcome;
- `save`, `load`: write and read its `Calibration`, which also has `correct`,
  `to_dataframe` and `to_latex`;
- `apply`: correct a recording with a calibration;
- `export_calibration`, `import_calibration`: write and read files for other programs;
- `type_prior`: estimate the prior of a new sensor from calibrations of earlier sensors;
- `analyse_noise`: find white noise, bias instability and random walk in a recording at rest;
- `simulate`, `demo`: simulate a bench, or calibrate on a simulated bench.

>>> import inercal
>>> inercal.calibrate  # doctest: +ELLIPSIS
<function calibrate at ...>

The names below are imported when they are first used, so that the command line starts quickly.
"""

from typing import TYPE_CHECKING, Any

from inercal.basics.kernel_cache import prepare_kernel_cache
from inercal.basics.lazy_names import lazy_names

if TYPE_CHECKING:
    from inercal.calibration import Calibration
    from inercal.calibration.files import load, save
    from inercal.export import export_calibration
    from inercal.export.readers import import_calibration
    from inercal.host.demonstration import demo
    from inercal.laboratory.type_prior import type_prior
    from inercal.noise import analyse_noise
    from inercal.pipeline import Outcome, apply, calibrate, simulate
    from inercal.pipeline.batch import calibrate_batch
    from inercal.report import plot_coverage, plot_residuals, write_report

_EXPORT_MODULES = {
    "Calibration": "calibration",
    "Outcome": "pipeline",
    "analyse_noise": "noise",
    "apply": "pipeline",
    "calibrate": "pipeline",
    "calibrate_batch": "pipeline.batch",
    "demo": "host.demonstration",
    "export_calibration": "export",
    "import_calibration": "export.readers",
    "load": "calibration.files",
    "plot_coverage": "report",
    "plot_residuals": "report",
    "write_report": "report",
    "save": "calibration.files",
    "simulate": "pipeline",
    "type_prior": "laboratory.type_prior",
}


_load = lazy_names(__name__, _EXPORT_MODULES)
_kernel_folder = prepare_kernel_cache()  # removed when the process ends


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("inercal")
    return _load(name)


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
    "type_prior",
    "write_report",
]

"""The patent's empirical Bayes: a prior from tests of single accelerometers, through files."""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from inercal.benches.dividing_head.bench import mounted_sensor
from inercal.calibration import Calibration
from inercal.calibration.files import save
from inercal.estimation import Estimate, Gaussian
from inercal.laboratory.type_prior import type_prior
from inercal.physics.sensors import Sensor
from inercal.runfile.priors import type_prior_of


def prior_from_files(tests: Estimate, terms: Sequence[str], sensor: Sensor) -> Gaussian:
    """Return the prior of a sensor, made in the same way as by `inercal prior`.

    Parameters
    ----------
    tests : Estimate
        Estimates of other accelerometers of the type, one for each test; the first axis is used.
    terms : sequence of str
    sensor : Sensor
    """
    axis = sensor.channels[0]
    picks = [k for k, name in enumerate(tests.names) if name.startswith(f"{axis}.")]
    with TemporaryDirectory() as folder:
        files: list[Path] = []
        for k, (value, covariance) in enumerate(zip(tests.value, tests.covariance, strict=True)):
            one = mounted_sensor(f"test {k + 1}", (axis,)).with_coefficients(
                *(tests.names[pick] for pick in picks)
            )
            found = Calibration(
                one, value[picks], covariance[np.ix_(picks, picks)], "tumble", "single", shared=()
            )
            files.append(save(found, Path(folder) / f"{k + 1}.calibration.json"))
        return type_prior_of(type_prior(files, terms).save(f"{folder}/type.prior.toml"), sensor)

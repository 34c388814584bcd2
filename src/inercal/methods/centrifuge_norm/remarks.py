"""What norms say beside an estimate: coefficients that explain the scatter, rows that violate it.

Rows are named with what would repair each. Nothing is changed: what was written is for the person
who has the original.
"""

from inercal.benches.centrifuge.bench import Centrifuge
from inercal.errors import InputError, NotObserved
from inercal.methods._base import Fit, Remarks
from inercal.methods.centrifuge_norm.omitted_coefficients import find_omitted_coefficients
from inercal.methods.centrifuge_norm.screening import screen_rows
from inercal.plan import Spin
from inercal.recording import Finding


def remarks(fit: Fit[Centrifuge, Spin]) -> Remarks:
    """Return warnings where the estimate does not agree with what was stated."""
    if fit.estimate.dof and fit.estimate.consistent:
        return Remarks()
    said: tuple[Finding, ...] = ()
    seen, bench, steps, priors = fit.observations, fit.bench, fit.steps, fit.priors
    try:
        explained = find_omitted_coefficients(seen, fit.sensor, bench, steps, priors)
        if explained.words:
            said = (Finding("warning", "left out", explained.describe()),)
        suspects = screen_rows(seen, explained.sensor, bench, steps, priors, explained.agreement)
    except NotObserved:
        return Remarks(said)  # the estimator says it better
    except InputError as error:
        return Remarks((*said, Finding("warning", "norm", str(error))))
    return Remarks((*said, *(Finding("warning", "norm", one.describe()) for one in suspects)))

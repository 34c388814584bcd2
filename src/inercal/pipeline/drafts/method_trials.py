"""Try each suitable method on the data, for means with the scatter that the residuals show."""

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from inercal.basics.errors import InercalError
from inercal.basics.units import format_count, format_quantity, si_factor
from inercal.pipeline.drafts.column_roles import ColumnRoles
from inercal.pipeline.drafts.draft_entries import UNKNOWN, DraftKey, as_sections
from inercal.recordings.io.column_table import shorten

if TYPE_CHECKING:
    from inercal.pipeline.outcome import Outcome

_LONGEST_REASON = 220  # characters

Candidate = tuple[str, str, dict[str, Any]]
"""Kind of bench, name of a method, and further keys of [method]."""

RAMP = "temperature_ramp"
"""Method for gyros at rest while their temperature changes."""

AUTO = {"also": "auto"}
"""Key for a method that can estimate more than it does by default."""
GUESS = "a guess that χ² cannot check: state the standard deviation of your means"
_FROM_RESIDUALS = (
    "the scatter that the residuals show, if the bench is as stated: state the measured scatter of "
    "your means to get a real test"
)
_SCATTER_ROUNDS, _SCATTER_AGREES = 6, 0.2
_ARM_DEVIATION = 1e-2
_MEAN_DEVIATION = 1e-4  # in gravity, for means without a stated scatter


class MethodTrial(NamedTuple):
    """The result of trying a method on the data.

    Parameters
    ----------
    name : str
    keys : dict of str to object
        Further keys of [method].
    outcome : Outcome or None
        Outcome of the calibration; None if the method was refused or not tried.
    reason : str
        Why the method was refused; empty if it works.
    key : str
        The run-file key that was refused, such as "[bench] tilt"; empty if none was.
    """

    name: str
    keys: dict[str, Any]
    outcome: "Outcome | None"
    reason: str = ""
    key: str = ""

    @property
    def called(self) -> str:
        """The name of the method with its keys."""
        return ", ".join([self.name, *(f"{key} = {value}" for key, value in self.keys.items())])

    @property
    def text(self) -> str:
        """A line with the result of the method, or the reason why it was refused."""
        if self.outcome is None:
            return f"{self.called}: {self.reason}"
        count = len(self.outcome.calibration.sensor.coefficients)
        return f"{self.called}: {format_count(count, 'coefficient')}, {self.outcome.verdict.word}"


def rests_in_ramp(roles: ColumnRoles) -> bool:
    """Return whether the columns are those of gyros at rest while their temperature changes."""
    gyros_only = "gyro" in roles.triads and not roles.triads.get("accelerometer")
    return gyros_only and not roles.means and {"temperature", "time"} <= roles.single.keys()


def candidate_methods(roles: ColumnRoles, *, heated: bool = False) -> tuple[Candidate, ...]:
    """Return the methods that may fit the columns, each with its bench and further keys.

    The first method that works on the data is proposed.

    Parameters
    ----------
    roles : ColumnRoles
    heated : bool
        Whether the temperature changes much.
    """
    triad = len(roles.triads.get("accelerometer", ()))
    if rests_in_ramp(roles):
        return (("hand", RAMP, {"temperature_order": "auto"}),)
    if roles.table:
        return (("turntable", "turntable_kalman", AUTO),)
    if "table_rate" in roles.single or roles.rates:
        # If only the axis of a single gyro was up, its misalignments are not determined.
        own_axis = {"coefficients": ["bias", "scale"]} | AUTO
        keys: list[dict[str, Any]] = [dict(AUTO), {}]
        keys += [own_axis] if len(roles.triads["gyro"]) < len("xyz") else []
        return tuple(("rate_platform", "rates_and_poses", one) for one in keys)
    if "mounting" in roles.single and "arm_rate" in roles.single:
        return (("rate_table", "ship_multi_angle", AUTO), ("rate_table", "ship_planar", AUTO))
    if "arm_rate" in roles.single and triad == 3:
        return (("centrifuge", "centrifuge_norm", AUTO),)
    if "angle" in roles.single and triad:
        names = ("dual_orthogonal", "tumble") if triad == 2 else ("tumble",)
        return tuple(("dividing_head", name, AUTO) for name in names)
    if triad < 3:
        return ()
    if roles.means:
        slopes = {"also": ["k0_dT", "k1_dT"]}
        by_temperature = [("hand", "six_position", slopes)] if "temperature" in roles.single else []
        return (*by_temperature, ("hand", "six_position", AUTO), ("hand", "multi_position", AUTO))
    turns = (360, -360) if "gyro" in roles.triads else ()
    ferraris: list[Candidate] = [
        ("hand", "ferraris", {"turn": f"{angle} °"} | AUTO) for angle in turns
    ]
    free: list[Candidate] = [("hand", "multi_position", AUTO)]
    six: list[Candidate] = [("hand", "six_position", AUTO)]
    warm: list[Candidate] = [("hand", "six_position", {"temperature_order": "auto"})]
    if "label" in roles.single or roles.marks not in ("", "found"):
        return tuple(ferraris + (warm if heated else []) + six + free)
    if heated or (roles.marks == "found" and "temperature" in roles.single):
        return tuple(warm + free + six)
    return tuple(free + ferraris + six)


def try_methods(
    entries: tuple[DraftKey, ...], candidates: Sequence[Candidate], folder: Path
) -> tuple[MethodTrial, ...]:
    """Try the candidates on the data until one works, and return all of them with results.

    Parameters
    ----------
    entries : tuple of DraftKey
        Keys of the run file without [method].
    candidates : sequence of Candidate
    folder : Path
        Folder of the run file.
    """
    from inercal.pipeline.run_calibration import calibrate_run
    from inercal.runfile import from_sections

    unknown = [entry.name for entry in entries if entry.value == UNKNOWN]
    trials: list[MethodTrial] = []
    stated = as_sections(entries).get("method", {})
    for _, name, own_keys in candidates:
        keys = {**own_keys, **stated}
        works = any(one.outcome and one.outcome.verdict.grade != "unreliable" for one in trials)
        if unknown or works:
            reason = f"not tried without {', '.join(unknown)}" if unknown else "not tried"
            trials.append(MethodTrial(name, keys, None, reason))
            continue
        content = as_sections(entries) | {"method": {"name": name, **keys}}
        run_file = folder / "draft"
        try:
            with _existing(folder):
                outcome = calibrate_run(from_sections(run_file, content, ""), advise=False)
        except InercalError as error:
            reason = str(error).removeprefix(f"{run_file}: ")
            reason = shorten(reason.partition(" (undetermined combinations")[0], _LONGEST_REASON)
            trials.append(MethodTrial(name, keys, None, reason, getattr(error, "key", "")))
        else:
            trials.append(MethodTrial(name, keys, outcome))
    return tuple(trials)


@contextmanager
def _existing(folder: Path) -> Generator[None]:
    """Make a folder exist for a while: paths are relative to it before anything is written."""
    missing = [one for one in (folder, *folder.parents) if not one.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    finally:
        for one in missing:
            one.rmdir()


def start_deviation(roles: ColumnRoles) -> float:
    """Return the initial deviation of means, in gravity; it is larger on an arm."""
    return _ARM_DEVIATION if "arm_rate" in roles.single else _MEAN_DEVIATION


def deviation_key(deviation: float, reason: str) -> DraftKey:
    """Return the key for the deviation of means, which is given in gravity."""
    return DraftKey(
        "data.sd",
        "accelerometer",
        format_quantity(deviation * si_factor("g"), 0.0, "µg", 2),
        reason,
    )


def with_scatter(
    entries: tuple[DraftKey, ...], candidates: Sequence[Candidate], folder: Path, deviation: float
) -> tuple[tuple[DraftKey, ...], tuple[MethodTrial, ...]]:
    """Try the candidates with the deviation of means that the data imply.

    If the residuals show that the guess is too large, the deviation that they imply is used.
    Otherwise the deviation is chosen so that χ² equals its degrees of freedom. Additional
    coefficients are only tested afterwards, because with too small a deviation the tests would find
    effects that do not exist.
    """
    plain = [(bench, name, {} if keys == AUTO else keys) for bench, name, keys in candidates]
    trials = try_methods(entries, plain, folder)
    outcome = next((one.outcome for one in trials if one.outcome is not None), None)
    findings = () if outcome is None else outcome.findings
    if factors := [one.factor for one in findings if one.what == "noise" and one.factor]:
        entries = _with_deviation(entries, deviation / max(factors), _FROM_RESIDUALS)
        return entries, try_methods(entries, candidates, folder)
    if plain != list(candidates):
        entries, _, deviation = _agreeing(entries, trials, plain, folder, deviation)
        trials = try_methods(entries, candidates, folder)
    return _agreeing(entries, trials, candidates, folder, deviation)[:2]


def _agreeing(
    entries: tuple[DraftKey, ...],
    trials: tuple[MethodTrial, ...],
    candidates: Sequence[Candidate],
    folder: Path,
    deviation: float,
) -> tuple[tuple[DraftKey, ...], tuple[MethodTrial, ...], float]:
    """Return entries and trials with the deviation at which χ² is near its dof, and this."""
    reason = (
        "chosen so that χ² fits, so χ² says nothing about the model: state the measured scatter of "
        "your means to get a real test"
    )
    given, before = (entries, trials, deviation), np.inf
    for _ in range(_SCATTER_ROUNDS):
        fits = [one.outcome.estimate for one in trials if one.outcome is not None]
        if not fits or not fits[0].dof:
            break
        # With few degrees of freedom this is the standard uncertainty (GUM Supplement 1, 6.4.9).
        dof = max(fits[0].dof - 2, fits[0].dof / 3)
        ratio = float(np.sqrt(max(fits[0].chi2 / dof, 1e-12)))
        if abs(ratio - 1) < _SCATTER_AGREES:
            return entries, trials, deviation
        if abs(np.log(ratio)) > 0.7 * before:
            break  # the errors of the bench explain the residuals for any scatter
        before = abs(np.log(ratio))
        deviation *= ratio
        entries = _with_deviation(entries, deviation, reason)
        trials = try_methods(entries, candidates, folder)
    return given


def _with_deviation(
    entries: tuple[DraftKey, ...], deviation: float, reason: str
) -> tuple[DraftKey, ...]:
    """Return the entries with another deviation of means; values that the user adds may follow."""
    found = deviation_key(deviation, reason)
    return tuple(found if one.dotted == found.dotted else one for one in entries)

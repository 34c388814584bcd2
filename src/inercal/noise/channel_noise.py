"""Store the results of a noise analysis: coefficients, tests and disturbances of each channel."""

from dataclasses import dataclass
from math import inf

from inercal.basics.errors import InputError
from inercal.basics.units import si_factor
from inercal.noise.deviations import Deviations
from inercal.noise.disturbances import Disturbance, SpectralLine
from inercal.noise.drift_regression import DriftTerm
from inercal.noise.goodness import Goodness
from inercal.noise.likelihood import NoiseFit
from inercal.noise.output_filter import OutputFilter
from inercal.noise.selection import Selection
from inercal.noise.spectrum import Bins
from inercal.noise.terms import TERMS
from inercal.physics.quantities import QUANTITIES as MEASURED
from inercal.physics.quantities import SensorKind

SI_UNIT: dict[SensorKind, str] = {one.sensor: one.unit for one in MEASURED.values()}
QUANTITIES: tuple[SensorKind, ...] = tuple(SI_UNIT)


@dataclass(frozen=True)
class NoiseCoefficient:
    """A noise coefficient, SI.

    Parameters
    ----------
    symbol : str
        "Q", "N", "B", "K", "G" (σ of a Gauss–Markov process) or "T" (its time constant, s).
    name : str
    value : float
        Value; 0 if only an upper limit is known.
    u : float
        Standard uncertainty; infinite if only an upper limit is known.
    low, high : float
        Ends of the ±2u interval from the profile likelihood; if only an upper limit is known, 0 and
        the limit (95 %).
    unit : str
        Display unit.
    ratio, limit : float
        2 ΔL relative to the best model without the term, and the limit for significance; both are 0
        for N and T.
    is_open : bool
        Whether it is undecided if the term is significant. This is so if a Gauss–Markov process
        fits better in place of the term, or if the user requested the term but the test does not
        find it.
    """

    symbol: str
    name: str
    value: float
    u: float
    low: float
    high: float
    unit: str
    ratio: float = 0.0
    limit: float = 0.0
    is_open: bool = False

    @property
    def is_limit(self) -> bool:
        """Whether only an upper limit is known."""
        return self.value == 0

    @property
    def is_significant(self) -> bool | None:
        """Whether the term is significant; None if this is undecided, and for T."""
        if self.symbol == "N":
            return not self.is_limit
        if self.symbol == "T" or (not self.is_limit and self.is_open):
            return None
        return not self.is_limit and self.ratio > self.limit

    @property
    def size(self) -> float:
        """Size of the display unit in SI."""
        return si_factor(self.unit)


def coefficient_unit(symbol: str, quantity: SensorKind) -> str:
    """Return the unit in which a coefficient is displayed."""
    return "s" if symbol == "T" else TERMS[symbol].units[quantity]


@dataclass(frozen=True)
class NoiseRefusal:
    """The reason why some coefficients of a channel are not stated.

    Parameters
    ----------
    symbols : tuple of str
        Symbols of the coefficients that are not stated.
    cause : str
    """

    symbols: tuple[str, ...]
    cause: str

    @property
    def text(self) -> str:
        """The refusal as one sentence."""
        names = f"{', '.join(self.symbols[:-1])} and {self.symbols[-1]}"
        return f"{names} cannot be stated, because {self.cause}"


@dataclass(frozen=True, eq=False)
class ChannelNoise:
    """The noise of one channel.

    Parameters
    ----------
    channel : str
    quantity : "gyro" or "accelerometer"
    n : int
        Number of samples in all pieces.
    dt : float
        Sampling interval Δ, s.
    mean : float
        Mean reading, SI.
    coefficients : tuple of NoiseCoefficient
        Coefficients that were estimated by `method`.
    deviations : dict of kind to Deviations
        Deviations by kind, SI.
    selection : Selection
    bins : Bins
    goodness : Goodness
    lines : tuple of SpectralLine
    disturbances : tuple of Disturbance
    drift : tuple of DriftTerm
    remarks : tuple of str
        Remarks on quantities that the recording cannot determine, and on how the recording was
        treated.
    comparison : dict of method to coefficients by symbol
        Cross-checks with other methods, SI.
    method : str
        "likelihood", "gmwm" or "wls_log".
    output : OutputFilter or None
        The sensor's own low-pass filter. If there is a filter, N is the density in its pass band.
    band : float
        Highest frequency that the fit uses, Hz; infinite if the fit uses all frequencies.
    refusal : NoiseRefusal or None
        Reason why the channel has no coefficients; None if it has coefficients.
    disturbed : str
        Why the coefficients are not to be relied on: the channel is saturated or stuck, or the
        disturbed times change the coefficients by more than U; otherwise empty.
    """

    channel: str
    quantity: SensorKind
    n: int
    dt: float
    mean: float
    coefficients: tuple[NoiseCoefficient, ...]
    deviations: dict[str, Deviations]
    selection: Selection
    bins: Bins
    goodness: Goodness
    lines: tuple[SpectralLine, ...]
    disturbances: tuple[Disturbance, ...]
    drift: tuple[DriftTerm, ...]
    remarks: tuple[str, ...]
    comparison: dict[str, dict[str, tuple[float, float]]]
    method: str = "likelihood"
    output: OutputFilter | None = None
    band: float = inf
    refusal: NoiseRefusal | None = None
    disturbed: str = ""

    @property
    def fit(self) -> NoiseFit:
        """The chosen model."""
        return self.selection.fit

    @property
    def oadev(self) -> Deviations:
        """Overlapping Allan deviation."""
        return self.deviations["oadev"]

    def coefficient(self, symbol: str) -> NoiseCoefficient | None:
        """Return a coefficient by its symbol; None if it was not estimated."""
        return next((one for one in self.coefficients if one.symbol == symbol), None)

    def value_or_limit(self, symbol: str) -> float:
        """Return a coefficient, or its upper limit if only the limit is known, SI; else 0."""
        found = self.coefficient(symbol)
        if found is None:
            return 0.0
        return found.high if found.is_limit else found.value

    def value(self, symbol: str) -> float:
        """Return a coefficient, SI; 0 if the model does not contain it or only a limit is known."""
        found = self.coefficient(symbol)
        return 0.0 if found is None else found.value


@dataclass(frozen=True, eq=False)
class NoiseAnalysis:
    """The noise of all channels of a recording.

    Parameters
    ----------
    source : str
        Name of the file; empty if there is no file.
    duration : float
        Duration of the recording, s.
    channels : tuple of ChannelNoise
    remarks : tuple of str
        Remarks on all channels, such as gaps and jitter.
    sha256 : str
        Hash of the file.
    movement : str
        Description of how the sensor moved; empty for a recording at rest.
    """

    source: str
    duration: float
    channels: tuple[ChannelNoise, ...]
    remarks: tuple[str, ...]
    sha256: str = ""
    movement: str = ""

    def channel(self, name: str) -> ChannelNoise:
        """Return a channel by its name.

        Raises
        ------
        InputError
            No channel has this name.
        """
        for one in self.channels:
            if one.channel == name:
                return one
        raise InputError(
            f"there is no channel {name!r}; the channels are "
            f"{', '.join(one.channel for one in self.channels)}"
        )

    def of(self, quantity: SensorKind) -> tuple[ChannelNoise, ...]:
        """Return the channels that measure a quantity."""
        return tuple(one for one in self.channels if one.quantity == quantity)


def quantity_of(unit: str, channel: str) -> SensorKind:
    """Return "gyro" for a unit of angular rate, and "accelerometer" for a unit of acceleration.

    Raises
    ------
    InputError
        The unit is neither a unit of angular rate nor of acceleration.
    """
    for quantity, like in SI_UNIT.items():
        try:
            si_factor(unit, like)
        except InputError:
            continue
        return quantity
    raise InputError(
        f"channel {channel} is in {unit!r}, but noise is stated for rates (rad/s, °/s) and "
        "accelerations (m/s², g); convert the readings, or state the scale factor",
        names=(channel,),
    )

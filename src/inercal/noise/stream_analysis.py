"""Analyse the noise of a recording that is read in blocks, with gaps and limited memory.

Each piece between gaps has a `StreamedChannel` for each channel. The likelihoods of the pieces are
added, as for a recording in memory. Block means of the temperature are also stored, because they
are needed to fit drift if there is only one piece.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.process_settings import with_one_thread
from inercal.basics.units import si_factor
from inercal.noise.analysis import candidate_models
from inercal.noise.channel_model import ChannelSummary, conclude
from inercal.noise.channel_noise import SI_UNIT, NoiseAnalysis, quantity_of
from inercal.noise.disturbances import SpectralLine, take_out_lines
from inercal.noise.drift_regression import LowFrequencies, LowPiece
from inercal.noise.pieces import FEWEST, join_deviations
from inercal.noise.recording_checks import check_rest_units
from inercal.noise.spectrum import Band, Spectrum, remove_band, require_bands
from inercal.noise.streaming import StreamedChannel, StreamedMeans
from inercal.physics.quantities import SensorKind
from inercal.physics.sensors import G0
from inercal.recordings import Recording

_MOST_STREAMS = 48  # channels times pieces; each stores at least 3 MB


@with_one_thread
def analyse_noise_stream(
    pieces: Iterable[Array],
    dt: float,
    channels: Sequence[str],
    units: Sequence[str],
    *,
    terms: str | None = None,
    source: str = "",
    gravity: float | None = G0,
) -> NoiseAnalysis:
    """Determine the noise of a recording without gaps that is read in pieces.

    The memory is limited: for 10⁸ samples, each channel needs about 30 MB
    (`inercal.noise.streaming`).

    Parameters
    ----------
    pieces : iterable of (k, m) array
        The pieces in time order; k may differ from piece to piece.
    dt : float
        Sampling interval Δ, s.
    channels, units : sequence of m str
    terms : str, optional
        See `analyse_noise`.
    source : str
        Name of the recording, used in messages.
    gravity : float or None
        See `analyse_noise`.

    Raises
    ------
    InputError
        See `analyse_noise`.
    """
    candidates = candidate_models(terms)
    stream = NoiseStream(dt, channels, units, source)
    for piece in pieces:
        stream.add(piece)
    return stream.analysis(candidates, gravity=gravity)


class NoiseStream:
    """Collect a recording block by block, and then determine its noise.

    Parameters
    ----------
    dt : float
        Sampling interval Δ, s.
    channels, units : sequence of m str
    source : str
        Name of the recording, used in messages.

    Raises
    ------
    InputError
        A unit is neither a rate nor an acceleration.
    """

    def __init__(self, dt: float, channels: Sequence[str], units: Sequence[str], source: str = ""):
        self.dt = dt
        self.source = source
        self.duration: float | None = None  # s, if times are known
        self.remarks: list[str] = []
        self._channels = tuple(channels)
        self._quantities: list[SensorKind] = [
            quantity_of(*one) for one in zip(units, channels, strict=True)
        ]
        self._sizes = [si_factor(unit) for unit in units]
        self._starts: list[float] = []
        self._pieces: list[list[StreamedChannel]] = []
        self._temperatures: list[StreamedMeans] = []
        self._left_out = 0
        self.begin_piece(0.0)

    def begin_piece(self, start: float) -> None:
        """End the current piece at a gap and begin a new one.

        Parameters
        ----------
        start : float
            Time of the next sample, s after the first sample of the recording.

        Raises
        ------
        InputError
            There are more pieces than the memory can store.
        """
        if self._pieces and self._pieces[-1][0].count < FEWEST:
            self._left_out += self._pieces.pop()[0].count
            self._temperatures.pop()
            self._starts.pop()
        if (len(self._pieces) + 1) * len(self._channels) > _MOST_STREAMS:
            raise InputError(
                f"{self.source or 'recording'}: there are too many gaps for an analysis in "
                f"blocks (up to {start:.6g} s); analyse the parts between long gaps one by one",
                file=self.source or None,
            )
        self._starts.append(start)
        self._pieces.append([StreamedChannel(self.dt) for _ in self._channels])
        self._temperatures.append(StreamedMeans())

    def add(self, values: Array, temperature: Array | None = None) -> None:
        """Add the next samples of all channels in their units, (k, m).

        Parameters
        ----------
        values : (k, m) array
        temperature : (k,) array, optional
            Temperatures, K; they must be given for all samples or for none.
        """
        if not len(values):
            return
        if temperature is not None:
            self._temperatures[-1].add(temperature)
        for k, one in enumerate(self._pieces[-1]):
            one.add(np.ascontiguousarray(values[:, k], dtype=np.float64) * self._sizes[k])

    def analysis(
        self,
        candidates: tuple[str, ...],
        skipped_bands: Sequence[Band] = (),
        sha256: str = "",
        gravity: float | None = G0,
    ) -> NoiseAnalysis:
        """Return the noise of all channels.

        Parameters
        ----------
        candidates : tuple of str
            Models from `candidate_models`.
        skipped_bands : sequence of (float, float)
            Bands to exclude from the fit, Hz.
        sha256 : str
            Hash of the recording.
        gravity : float or None
            See `analyse_noise`.

        Raises
        ------
        InputError
            There are fewer than 64 samples, accelerometers do not read gravity, or readings are
            rounded too coarsely.
        """
        if self._pieces[-1][0].count < FEWEST:
            self._left_out += self._pieces.pop()[0].count
            self._temperatures.pop()
        if not self._pieces:
            raise InputError(
                f"{self.source or 'recording'} has fewer than {FEWEST} samples without a gap",
                file=self.source or None,
            )
        require_bands(skipped_bands, self.dt)
        for channels in self._pieces:
            for one in channels:
                one.dt = self.dt
        units = check_rest_units(self.block_mean_recording(), gravity)
        found = [
            conclude(self._summary(k, skipped_bands), candidates, "likelihood")
            for k in range(len(self._channels))
        ]
        duration = self.duration
        if duration is None:
            last = len(self._pieces) - 1
            duration = self._starts[last] + (self._pieces[last][0].count - 1) * self.dt
        remarks = (*units, *self._all_remarks())
        return NoiseAnalysis(self.source, duration, tuple(found), remarks, sha256)

    def _all_remarks(self) -> tuple[str, ...]:
        remarks = list(self.remarks)
        if len(self._pieces) > 1:
            remarks.append(
                f"gaps split the recording into {len(self._pieces)} pieces, each with its own "
                "likelihood; averaging times are limited by the longest piece"
            )
        if self._left_out:
            remarks.append(
                f"{self._left_out} samples in pieces shorter than {FEWEST} were excluded"
            )
        return tuple(remarks)

    def _summary(self, k: int, skipped_bands: Sequence[Band]) -> ChannelSummary:
        parts = [channels[k] for channels in self._pieces]
        clean: list[tuple[Spectrum, tuple[SpectralLine, ...]]] = []
        low: list[LowPiece] = []
        for part, start, warmth in zip(parts, self._starts, self._temperatures, strict=False):
            values, dt = part.low_values()
            low.append(LowPiece(len(clean), start, dt, values, warmth.means()))
            clean += [take_out_lines(remove_band(one, skipped_bands)) for one in part.spectra()]
        octaves = join_deviations([part.oadev() for part in parts])
        n = sum(part.count for part in parts)
        remarks = [text for part in parts for text in part.remarks(self._channels[k], self.source)]
        remarks += [
            f"{low:g}–{high:g} Hz were excluded from the fit" for low, high in skipped_bands
        ]
        return ChannelSummary(
            channel=self._channels[k],
            quantity=self._quantities[k],
            n=n,
            longest=max(part.count for part in parts),
            dt=self.dt,
            mean=sum(part.mean * part.count for part in parts) / n,
            spectra=tuple(spectrum for spectrum, _ in clean),
            lines=tuple(line for _, lines in clean for line in lines),
            octaves=octaves,
            deviations={"oadev": octaves},
            disturbances=tuple(
                one.shifted(start)
                for part, start in zip(parts, self._starts, strict=False)
                for one in part.disturbances()
            ),
            remarks=tuple(dict.fromkeys(remarks)),
            low=LowFrequencies.of(low),
            step=max(parts, key=lambda part: part.count).rounding_step(),
        )

    def block_mean_recording(self) -> Recording:
        """Return block means of the longest piece in SI, for plots over time."""
        k = max(range(len(self._pieces)), key=lambda one: self._pieces[one][0].count)
        found = [one.low_values() for one in self._pieces[k]]
        dt = found[0][1]
        data = np.stack([values for values, _ in found], axis=1)
        data = data + np.array([one.origin for one in self._pieces[k]])
        return Recording(
            self._starts[k] + dt * np.arange(float(len(data))),
            data,
            self._channels,
            tuple(SI_UNIT[one] for one in self._quantities),
            source=self.source,
        )

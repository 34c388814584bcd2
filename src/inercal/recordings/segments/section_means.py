"""Average marked sections to observations: means with their covariance.

The noise of the sections at rest is pooled. Its density at zero frequency, from batch means, gives
the covariance of each mean. This also applies to turns, because the scatter within a turn is motion
and not noise. A correlation longer than a batch increases the covariance, and a section with
unusual scatter gets its own variance (`inercal.recordings.segments.section_noise`). Bias
instability and random walk act between sections and are not estimated; they are taken from the
sensor's stated noise. If none is stated, a drift cannot be excluded; if one is stated, the slopes
may show that the drift is larger. The slopes within all sections measure a drift that is quadratic
in time, with an uncertainty several times that of a mean. This drift is subtracted from the means,
and its covariance between the means is kept. The fit therefore combines it with all other data that
reveal a drift, such as repeated positions, as if it had used means and slopes together.

A slow temperature ramp changes the bias within a section, which is not noise. Over all sections,
each channel has two temperature slopes, one for its bias and one for its scale factor, found by
least squares::

    y − ȳ = (a + b ȳ)(T − T̄) + noise

The effect of temperature changes is subtracted before the noise is estimated. The means are not
changed, because the temperature coefficients describe the effect of T̄. If the temperature varies
by less than 0.02 K, the section counts as isothermal: otherwise, noise of the temperature sensor
would explain part of the readings' noise.

Slow bias drift gives the means of sections a covariance. For noise with the two-sided spectrum
S(f), the covariance of means over T_r and T_s, centred at t_r and t_s, is ∫ S(f) sinc(f T_r) sinc(f
T_s) cos 2πf(t_r − t_s) df with sinc x = sin πx / πx. Bias instability has S = B²/(2πf) (IEEE Std
952, annex B), cut off below 1/(4 × the recording's length), because slower noise is part of the
estimated bias. A random walk K starts with the recording; its covariance at times t and t' is K²
min(t, t').
"""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import format_count
from inercal.estimation.uncertainty import BATCHES, pooled_mean_covariances
from inercal.physics.plan import Rotation, Step, Turn
from inercal.physics.sensors import Noise, Sensor
from inercal.recordings import Mark, Observations, Recording, add_rounding
from inercal.recordings.segments.attitudes import flaws_of_mark
from inercal.recordings.segments.reading_steps import reading_steps
from inercal.recordings.segments.rest_changes import require_still
from inercal.recordings.segments.section_noise import (
    SectionNoise,
    density_without_hand_motion,
    drift_notes,
    noise_degrees_of_freedom,
    section_noise_statistics,
)
from inercal.recordings.temperature import temperature_varies

_POINTS_A_DECADE = 400  # where the cosine varies faster than this, the sincs damp it
_BEYOND = 30.0  # cycles in the shortest section, above which the sincs are negligible


def even_drift_covariance(noise: Noise, count: int, seconds: float) -> Array:
    """Return the covariance of an axis's drift between means of equal blocks, (count, count).

    The result is as in `drift_covariance`, for equal blocks without pauses between them. The
    flicker part then depends only on the time between two blocks.

    Parameters
    ----------
    noise : Noise
    count : int
    seconds : float
        Length of a block, s.
    """
    low, high = 0.25 / (count * seconds), _BEYOND / seconds
    f: Array = np.geomspace(low, high, int(_POINTS_A_DECADE * np.log10(high / low)) + 2)
    apart = np.arange(count)
    smooth: Array = np.sinc(f * seconds) ** 2 / np.pi
    flicker = np.cos(2 * np.pi * seconds * np.outer(apart, f)) @ (_trapezoid(f) * smooth)
    middles = (apart + 0.5) * seconds
    walk = np.minimum(middles[:, None], middles)
    np.fill_diagonal(walk, middles - seconds / 6)
    between = flicker[np.abs(apart[:, None] - apart)]
    return noise.bias_instability**2 * between + noise.random_walk**2 * walk


def _trapezoid(f: Array) -> Array:
    """Return the weights for an integral over df/f = d(ln f)."""
    steps = np.diff(np.log(f))
    weight = np.zeros(f.size)
    weight[1:] += 0.5 * steps
    weight[:-1] += 0.5 * steps
    return weight


def drift_covariance(
    noises: Sequence[Noise], middles: Array, durations: Array, length: float
) -> Array | None:
    """Return the covariance between the r means in m channels, (r, r, m); None if no drift.

    Parameters
    ----------
    noises : sequence of m Noise
        Noise of each channel.
    middles, durations : (r,) arrays
        Time of the middle of each section from the start of the recording, and its duration, s;
        sections must not overlap.
    length : float
        Duration of the recording, s.
    """
    flickers = np.array([noise.bias_instability for noise in noises])
    walks = np.array([noise.random_walk for noise in noises])
    if not (flickers.any() or walks.any()):
        return None
    low, high = 0.25 / length, _BEYOND / float(durations.min())
    points = int(_POINTS_A_DECADE * np.log10(high / low)) + 2
    f: Array = np.geomspace(low, high, points)
    smooth: Array = np.sinc(f * durations[:, None])
    i, j = np.triu_indices(middles.size)
    apart = np.outer(middles[j] - middles[i], 2 * np.pi * f)
    flicker = np.empty((middles.size, middles.size))
    # The factor 2 accounts for negative frequencies.
    weight = _trapezoid(f) / np.pi
    flicker[i, j] = flicker[j, i] = (smooth[i] * smooth[j] * np.cos(apart)) @ weight
    walk = np.minimum(middles[:, None], middles)
    # Within a section, the average of min(t, t') is its start plus a third of its length.
    np.fill_diagonal(walk, middles - durations / 6)
    return flicker[..., None] * flickers**2 + walk[..., None] * walks**2


Sections = Callable[[], Iterable[Array]]
"""Function that returns the sections, (..., n, m) each, anew at each call."""
MIN_SAMPLES = 20  # with fewer samples there are no batches from which to estimate the noise
_CONSTANT = 0.02  # K
_FREEDOM = 342  # degrees of freedom of the noise, as for 18 rests with 20 batches each


def average_sections(
    recording: Recording,
    sensor: Sensor,
    marks: Sequence[Mark],
    steps: Sequence[Step],
    *,
    by_hand: bool = False,
    found: bool = False,
    drifting: bool = False,
    turning: Sequence[str] = (),
    known: Callable[[str], Array | float] | None = None,
) -> Observations:
    """Average each marked step to one row, in the order of `steps`.

    Parameters
    ----------
    recording : Recording
    sensor : Sensor
        Sensor whose axes name the channels to use; its readout converts to SI units.
    marks : sequence of Mark
    steps : sequence of Step
    by_hand : bool
        Whether the sensor trembles in a hand. The accelerometers' noise is then estimated along
        gravity (`inercal.recordings.segments.section_noise`). Requires data without a trial
        axis.
    found : bool
        Whether the sections are known to be at rest, because they were detected by their scatter or
        checked by `require_still`.
    drifting : bool
        Whether to return the drift of the accelerometers, relative to the middle of the rests, in
        `drift_mean`, as found from the slopes of the sections, and the covariance of its remaining
        uncertainty in `drift`. Requires data without a trial axis.
    turning : sequence of str
        Labels of further steps whose scatter is motion.
    known : callable, optional
        Function that returns the known changes of the readings within the section with a label,
        (n, m) SI. They are subtracted before the noise is estimated; the means are not changed.

    Raises
    ------
    InputError
        A section is too short or contains a flaw of the recording, or no hold is marked.
    """
    by_label = {mark.label: mark for mark in marks}
    used = [step for step in steps if step.label in by_label]
    columns = [recording.channels.index(name) for name in sensor.channels]

    def section(step: Step, data: Array = recording.data) -> Array:
        # Convert at each call, because all sections together may be as large as the recording.
        mark = by_label[step.label]
        return sensor.to_si(data[..., mark.start : mark.stop, columns])

    for step in used:
        mark = by_label[step.label]
        _refuse_flaws(recording, mark, step, sensor.channels)
        if mark.stop - mark.start < MIN_SAMPLES:
            raise InputError(
                f"{recording.source}: section {mark.label} has "
                f"{format_count(mark.stop - mark.start, 'sample')}; mark at least {MIN_SAMPLES}",
                names=(mark.label,),
            )
    moving = [s.label for s in used if isinstance(s, Turn | Rotation) or s.label in turning]
    holds = [step for step in used if step.label not in moving]
    if not holds:
        raise InputError(f"{recording.source}: no position at rest is marked; mark at least one")
    if not found:
        require_still(recording, sensor, [by_label[step.label] for step in holds])
    batches = max(4, min(BATCHES, -(-_FREEDOM // len(holds)) + 1))
    temperature = recording.temperature

    def resting(data: Array, kelvin: Array | None) -> Sections:
        """Return the sections at rest, without the effect of a temperature change within them."""

        def raw() -> Iterable[Array]:
            return (section(s, data) - (known(s.label) if known else 0.0) for s in holds)

        if kelvin is None or not sensor.uses("dT"):
            return raw
        spans = [slice(by_label[s.label].start, by_label[s.label].stop) for s in holds]
        return remove_temperature_trend(raw, [kelvin[..., span] for span in spans])

    at_rest_all = resting(recording.data, temperature)
    of_holds, dof = pooled_mean_covariances(at_rest_all(), batches)
    samples = np.array([by_label[step.label].stop - by_label[step.label].start for step in used])
    density = of_holds[0] * samples[used.index(holds[0])]
    if by_hand:
        density = density_without_hand_motion(density, sensor, at_rest_all())
        dof = min(dof, noise_degrees_of_freedom(len(holds)))
    ranges = [(by_label[step.label].start, by_label[step.label].stop) for step in used]
    at_rest = [used.index(step) for step in holds]
    rests = [ranges[k] for k in at_rest]
    steps_of_readings = reading_steps(recording.data, columns, sensor, rests)
    coarse = steps_of_readings.variance
    durations = np.array([recording.span(*limits) for limits in ranges])
    middles = np.array([recording.time[start] for start, _ in ranges]) + 0.5 * durations
    covariance = density[..., None, :, :] / samples[:, None, None]
    names = [step.label for step in holds]
    since = middles - middles[at_rest].mean()

    def judged(of: Sections) -> tuple[Array, SectionNoise]:
        """Return factors for the standard deviations of all rows, (r, m), and noise statistics."""
        noise = section_noise_statistics(
            sensor, of, durations[at_rest], since[at_rest], names, coarse, by_hand=by_hand
        )
        variance = noise.factor(durations, durations[at_rest], batches)
        variance[at_rest] *= noise.scale
        return np.sqrt(variance), noise

    of_rows = None
    if temperature is not None:
        of_rows = np.stack([temperature[..., a:b].mean(axis=-1) for a, b in ranges], axis=-1)
    tests, notes, noise, course = (), (), None, None
    noises, elapsed = [axis.noise for axis in sensor.axes], middles - recording.time[0]
    drift = drift_covariance(noises, elapsed, durations, recording.duration)
    if recording.data.ndim == 2:
        factor, noise = judged(at_rest_all)
        tests, notes = noise.tests, noise.notes
        slow = noise.drift
        if sensor.uses("dT") and temperature_varies(of_rows):
            # A drift of the accelerometers cannot be distinguished from temperature terms.
            slow = slow.of_channels([axis.measures == "w" for axis in sensor.axes])
        if drifting and slow.covariance.any():
            course, shared = slow.course(since, recording.duration)
            drift = shared if drift is None else drift + shared
            middle = float((middles - since)[0] - recording.time[0])
            of_drift = noise._replace(drift=slow)
            notes = (*notes, *drift_notes(sensor, of_drift, recording.duration, middle))
    else:
        trials: Array = np.reshape(recording.data, (-1, *recording.data.shape[-2:]))
        kelvins: list[Array | None] = [temperature] * len(trials)
        if temperature is not None and temperature.ndim > 1:
            kelvins = list(np.broadcast_to(temperature, trials.shape[:-1]).reshape(len(trials), -1))
        each = zip(trials, kelvins, strict=True)
        factor = np.stack([judged(resting(one, kelvin))[0] for one, kelvin in each])
        factor = factor.reshape(*recording.data.shape[:-2], *factor.shape[1:])
    covariance = covariance * factor[..., :, None] * factor[..., None, :]
    if noise is not None:
        covariance[at_rest] += noise.disturbance_variance[:, :, None] * np.eye(len(columns))
    mean = np.stack([section(step).mean(axis=-2) for step in used], axis=-2)
    rounding = None
    if coarse.any():
        trial = recording.data.reshape(-1, *recording.data.shape[-2:])[0]
        crossed = steps_of_readings.crossed([section(step, trial) for step in used])
        rounding = steps_of_readings.errors_of_means(mean, crossed)
    rounding, covariance, further = add_rounding(sensor, rounding, covariance, coarse)
    return Observations(
        labels=tuple(step.label for step in used),
        mean=mean,
        covariance=covariance,
        duration=durations,
        samples=samples,
        time=middles,
        channels=sensor.channels,
        dof=dof,
        drift=drift,
        drift_mean=course,
        rounding=rounding,
        tests=tests,
        notes=(*notes, *further),
        temperature=of_rows,
    )


def _refuse_flaws(recording: Recording, mark: Mark, step: Step, channels: Sequence[str]) -> None:
    """Refuse a section with saturated or stuck samples, or a turn with lost samples."""
    where = f"{recording.source}: section {mark.label} (samples {mark.start} to {mark.stop})"
    for flaw in flaws_of_mark(recording, mark):
        if flaw.channel is None or flaw.channel in channels:
            raise InputError(
                f"{where} cannot be used: {flaw.message}; mark a section without it or record "
                "again",
                names=(mark.label,),
            )
    lost = (recording.gaps[:, 0] >= mark.start) & (recording.gaps[:, 1] < mark.stop)
    if isinstance(step, Turn) and lost.any():
        after = int(recording.gaps[np.argmax(lost), 0])
        raise InputError(
            f"{where} cannot be used: samples were lost after sample {after}, so part of "
            "the turn's angle is missing; record it again",
            names=(mark.label,),
        )


def remove_temperature_trend(sections: Sections, temperature: Sequence[Array]) -> Sections:
    """Return r sections without the effect of temperature changes within them.

    Parameters
    ----------
    sections : Sections
    temperature : sequence of r (..., n) array
        Temperature of each sample, K.
    """
    away = [_temperature_departure(kelvin) for kelvin in temperature]
    if not any(t.any() for t in away):
        return sections
    gram: Array = np.zeros((2, 2))
    product: Array = np.zeros(2)
    for y, t in zip(sections(), away, strict=True):
        mean = y.mean(axis=-2)
        by = np.stack([np.ones_like(mean), mean], axis=-1)  # (..., m, 2)
        square = (t**2).sum(axis=-1)[..., None, None, None]
        gram = gram + square * by[..., :, None] * by[..., None, :]
        product = product + (t[..., None] * (y - mean[..., None, :])).sum(axis=-2)[..., None] * by
    slopes = (np.linalg.pinv(gram) @ product[..., None])[..., 0]  # (..., m, 2)

    def without() -> Iterable[Array]:
        for y, t in zip(sections(), away, strict=True):
            slope = slopes[..., 0] + slopes[..., 1] * y.mean(axis=-2)
            yield y - t[..., None] * slope[..., None, :]

    return without


def _temperature_departure(kelvin: Array) -> Array:
    """Return the deviation from the mean, (..., n) K; zero for sections of constant temperature."""
    away = kelvin - kelvin.mean(axis=-1, keepdims=True)
    return np.where(np.ptp(kelvin, axis=-1, keepdims=True) > _CONSTANT, away, 0.0)

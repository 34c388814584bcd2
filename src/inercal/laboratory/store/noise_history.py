"""Insert noise analyses into a register, read them, and compare them over time.

Relative to the previous analysis, E_n of a coefficient is |Δ|/(2 √(u₁² + u₂²)), with the u of both
analyses. If E_n exceeds 1, the coefficient changed. Two analyses of one recording are not repeated
measurements, so only the later entry is used.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from math import hypot, inf, isfinite
from typing import Any

import sqlalchemy as sa

from inercal.basics.documents import stated_time
from inercal.basics.errors import InputError
from inercal.laboratory.store.insertions import EntryAuthor, enter_axes, insert_row
from inercal.laboratory.store.queries import find_sensor
from inercal.laboratory.store.register_tables import noise_analysis, noise_coefficient, sensor
from inercal.noise import NoiseAnalysis, NoiseCoefficient
from inercal.noise.texts import analysis_object
from inercal.physics.quantities import QUANTITIES

_MEASURES = {one.sensor: one.symbol for one in QUANTITIES.values()}


@dataclass(frozen=True)
class NoiseEntry:
    """A noise analysis in the register.

    Parameters
    ----------
    id : int
    sensor : str
    measured : str
        Time of measurement, ISO 8601, UTC.
    measured_from : "stated" or "entered"
        Source of the time of measurement: the user, or the time of entry.
    source : str
        Name of the recording file.
    recording_sha256 : str
    duration : float
        Duration of the recording, s.
    coefficients : dict of channel to tuple of NoiseCoefficient
        Coefficients in SI units. The significance of terms is only in `content`.
    by, at : str
        Author and time of the entry, ISO 8601, UTC.
    content : str
        The whole analysis as JSON.
    """

    id: int
    sensor: str
    measured: str
    measured_from: str
    source: str
    recording_sha256: str
    duration: float
    coefficients: Mapping[str, tuple[NoiseCoefficient, ...]]
    by: str
    at: str
    content: str = field(repr=False)


@dataclass(frozen=True)
class NoiseTrend:
    """A noise coefficient of a channel over time.

    Parameters
    ----------
    channel, symbol, unit : str
    entries : tuple of NoiseEntry
        The entries that have the coefficient, oldest first.
    values : tuple of NoiseCoefficient
        One value for each entry.
    """

    channel: str
    symbol: str
    unit: str
    entries: tuple[NoiseEntry, ...]
    values: tuple[NoiseCoefficient, ...]

    @property
    def normalised_errors(self) -> tuple[float | None, ...]:
        """E_n relative to the previous value; None for the first, or if one is only a limit."""
        found: list[float | None] = [None]
        for before, after in pairwise(self.values):
            u = hypot(before.u, after.u)
            known = isfinite(u) and u > 0
            found.append(abs(after.value - before.value) / (2 * u) if known else None)
        return tuple(found)

    @property
    def changed(self) -> bool:
        """Whether the newest value differs significantly from the previous one (E_n > 1)."""
        last = self.normalised_errors[-1]
        return last is not None and last > 1


def enter_noise(
    db: sa.Connection, analysis: NoiseAnalysis, name: str, measured: str | None, who: EntryAuthor
) -> int:
    """Enter a noise analysis, and also its sensor if it is new; return the analysis number.

    The same analysis of the same sensor is entered only once.

    Raises
    ------
    InputError
        If the name is empty, or `measured` is not a time.
    """
    if not name.strip():
        raise InputError(
            "a noise analysis in the register needs the name of a sensor; give one", key="--sensor"
        )
    time, origin = who.at, "entered"
    if measured is not None:
        time, origin = stated_time(measured), "stated"
    found = db.scalar(sa.select(sensor.c.id).where(sensor.c.name == name))
    axes = {one.channel: _MEASURES[one.quantity] for one in analysis.channels}
    # The axes of a known sensor are not changed, because channels of a log may have other names.
    sensor_id = enter_axes(db, name, axes, who) if found is None else int(found)
    content = json.dumps(analysis_object(analysis), ensure_ascii=False, allow_nan=False)
    digest = hashlib.sha256(content.encode()).hexdigest()
    same = (noise_analysis.c.sensor_id == sensor_id, noise_analysis.c.sha256 == digest)
    if (there := db.scalar(sa.select(noise_analysis.c.id).where(*same))) is not None:
        return int(there)
    values = {
        "sensor_id": sensor_id,
        "measured": time,
        "measured_from": origin,
        "source": analysis.source,
        "recording_sha256": analysis.sha256,
        "duration": analysis.duration,
        "content": content,
        "sha256": digest,
    }
    number = insert_row(db, noise_analysis, values, who)
    rows = [
        {"analysis_id": number, "channel": channel.channel, "place": place}
        | _coefficient_fields(one)
        | {"u": one.u if isfinite(one.u) else None}
        for channel in analysis.channels
        for place, one in enumerate(channel.coefficients)
    ]
    if rows:
        db.execute(sa.insert(noise_coefficient), rows)
    return number


def _coefficient_fields(one: NoiseCoefficient) -> dict[str, Any]:
    """Return the columns of a coefficient, which are also its keys in a JSON object."""
    return {name: getattr(one, name) for name in ("symbol", "value", "u", "low", "high", "unit")}


def read_noise(db: sa.Connection, key: int | str) -> tuple[NoiseEntry, ...]:
    """Return the noise analyses of the sensor with this id or name, in the order of measurement.

    Raises
    ------
    InputError
        If there is no such sensor, or the text in the register differs from the text that was
        entered.
    """
    sensor_id = find_sensor(db, key).id
    query = (
        sa.select(noise_analysis, sensor.c.name.label("sensor"))
        .join(sensor, sensor.c.id == noise_analysis.c.sensor_id)
        .where(noise_analysis.c.sensor_id == sensor_id)
        .order_by(noise_analysis.c.measured, noise_analysis.c.id)
    )
    rows = db.execute(query).all()
    coefficients = _coefficients(db, sensor_id)
    for row in rows:
        if hashlib.sha256(row.content.encode()).hexdigest() != row.sha256:
            raise InputError(
                f"the register is damaged: the content of noise analysis {row.id} is not what "
                "was entered; restore the register from a copy",
                key="--register",
            )
    return tuple(
        NoiseEntry(
            row.id, row.sensor, row.measured, row.measured_from, row.source, row.recording_sha256,
            row.duration, coefficients.get(row.id, {}), row.entered_by, row.entered_at, row.content,
        )
        for row in rows
    )  # fmt: skip


def _coefficients(
    db: sa.Connection, sensor_id: int
) -> dict[int, dict[str, tuple[NoiseCoefficient, ...]]]:
    query = (
        sa.select(noise_coefficient)
        .join(noise_analysis, noise_analysis.c.id == noise_coefficient.c.analysis_id)
        .where(noise_analysis.c.sensor_id == sensor_id)
        .order_by(
            noise_coefficient.c.analysis_id, noise_coefficient.c.channel, noise_coefficient.c.place
        )
    )
    found: dict[int, dict[str, tuple[NoiseCoefficient, ...]]] = {}
    for row in db.execute(query):
        u = inf if row.u is None else row.u
        one = NoiseCoefficient(row.symbol, "", row.value, u, row.low, row.high, row.unit)
        channels = found.setdefault(row.analysis_id, {})
        channels[row.channel] = (*channels.get(row.channel, ()), one)
    return found


def noise_trends(entries: tuple[NoiseEntry, ...]) -> tuple[NoiseTrend, ...]:
    """Return the coefficients of all channels over time, from the last entry of each recording."""
    in_order = sorted(entries, key=lambda one: one.id)
    last = {one.recording_sha256 or f"#{one.id}": one.id for one in in_order}
    kept = [one for one in entries if last[one.recording_sha256 or f"#{one.id}"] == one.id]
    points: dict[tuple[str, str, str], list[tuple[NoiseEntry, NoiseCoefficient]]] = {}
    for entry in kept:
        for channel, coefficients in entry.coefficients.items():
            for one in coefficients:
                points.setdefault((channel, one.symbol, one.unit), []).append((entry, one))
    return tuple(
        NoiseTrend(*key, tuple(one for one, _ in found), tuple(one for _, one in found))
        for key, found in points.items()
    )


def noise_entry_object(entry: NoiseEntry) -> dict[str, Any]:
    """Return an entry as a JSON object, with its coefficients but without its content."""
    hidden = ("coefficients", "content")
    return {name: value for name, value in vars(entry).items() if name not in hidden} | {
        "coefficients": [
            {"channel": channel} | _coefficient_fields(one)
            for channel, coefficients in entry.coefficients.items()
            for one in coefficients
        ]
    }

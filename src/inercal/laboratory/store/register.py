"""Open the register of a laboratory, insert entries and read them."""

import os
from collections.abc import Callable, Collection, Generator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Concatenate, ParamSpec, TypeVar

from sqlalchemy import Connection, select

from inercal.basics.closeable import Closeable
from inercal.basics.documents import stated_time
from inercal.basics.process_settings import user_name
from inercal.calibration import Calibration
from inercal.laboratory.store import certificates, connection, insertions, queries
from inercal.laboratory.store.connection import require_place_of_register, resolve_address
from inercal.laboratory.store.entries import CalibrationEntry, RunEntry, RunFacts, SensorEntry
from inercal.laboratory.store.history import SensorHistory, build_history
from inercal.laboratory.store.insertions import make_document, utc_now
from inercal.laboratory.store.noise_history import NoiseEntry, enter_noise, read_noise
from inercal.laboratory.store.register_tables import calibration
from inercal.noise import NoiseAnalysis
from inercal.physics.sensors import Sensor

_P = ParamSpec("_P")
_T = TypeVar("_T")


class Register(Closeable):
    """A register of sensors, benches, runs, hashes of raw data and calibrations.

    Each entry has an author and a time. The register is a context manager. Each call is a separate
    transaction, and several processes and threads may have the same register open.

    Parameters
    ----------
    address : str, optional
        A path, "sqlite:///PATH" or "postgresql://USER@HOST/DATABASE". None or "default" means
        $INERCAL_REGISTER. If this is not set, it means inercal/register.db in $XDG_DATA_HOME or
        ~/.local/share.
    by : str, optional
        Author of new entries; by default, the user of the system.
    create : bool
        Whether a missing register is created on first use.

    Attributes
    ----------
    files : tuple of Path
        The file of the register; empty for a server.
    address : str
        Address for printing, without a password.
    exists : bool
        Whether the register exists. If not, it is created on first use.

    Raises
    ------
    InputError
        If nothing can be opened at the address, if it is not a register or was written by a newer
        version, or if there is no register and `create` is false.
    """

    def __init__(self, address: str | None = None, by: str | None = None, *, create: bool = True):
        self._address = resolve_address(address)
        self.address = self._address.display_url
        self._by = by or user_name()
        self.files = () if self._address.file is None else (self._address.file,)
        self._engine = connection.make_engine(self._address)
        file = self._address.file
        self.exists = file is None or os.path.exists(file)
        if file is not None and not self.exists:
            require_place_of_register(file, create=create)
        else:
            connection.upgrade_register(self._engine, self._address, create=create)

    @contextmanager
    def _transaction(
        self, begin: Callable[..., AbstractContextManager[Connection]]
    ) -> Generator[Connection]:
        if not self.exists:
            connection.upgrade_register(self._engine, self._address)
            self.exists = True
        with begin(self._engine, self._address) as db:
            yield db

    def _read(
        self, query: Callable[Concatenate[Connection, _P], _T], *args: _P.args, **more: _P.kwargs
    ) -> _T:
        """Return the result of a query in a transaction of its own."""
        with self._transaction(connection.read_transaction) as db:
            return query(db, *args, **more)

    def sensors(self) -> tuple[SensorEntry, ...]:
        """Return all sensors, sorted by name."""
        return self._read(queries.sensors)

    def sensor(self, key: int | str) -> SensorEntry:
        """Return the sensor with this id or name.

        Raises
        ------
        InputError
            If there is none.
        """
        return self._read(queries.find_sensor, key)

    def runs(
        self, sensor: int | str | None = None, newest: int | None = None
    ) -> tuple[RunEntry, ...]:
        """Return the runs of all sensors or of one, by start time; or only the `newest` runs."""
        return self._read(queries.runs, sensor_key=sensor, newest=newest)

    def calibrations(
        self, sensor: int | str | None = None, newest: int | None = None
    ) -> tuple[CalibrationEntry, ...]:
        """Return the calibrations of all sensors, or of one sensor, in the order of measurement.

        Parameters
        ----------
        sensor : int or str, optional
            Id or name of the sensor.
        newest : int, optional
            Number of calibrations to return, counted from the last measurement; None returns all.
        """
        return self._read(queries.calibrations, sensor_key=sensor, newest=newest)

    def entered_sha256(self, wanted: Collection[str]) -> set[str]:
        """Return which of these SHA-256 hashes of calibration files are in the register."""
        query = select(calibration.c.sha256).where(calibration.c.sha256.in_(wanted))
        return self._read(lambda db: set(db.scalars(query)))

    def calibration_numbers(self, run_id: int | None = None) -> tuple[int, ...]:
        """Return the numbers of all calibrations, or of one run's, in the order of measurement."""
        where = [] if run_id is None else [calibration.c.run_id == run_id]
        return self._read(queries.calibration_numbers, *where)

    def calibration(self, number: int) -> CalibrationEntry:
        """Return the calibration with this number.

        Raises
        ------
        InputError
            If no calibration has this number.
        """
        return self._read(queries.find_calibration, number)

    def coefficients(self, number: int) -> Sequence[tuple[str, float, float, str]]:
        """Return the name, value, standard uncertainty (k = 1) and SI unit of each coefficient."""
        return self._read(queries.coefficients, number)

    def history(self, sensor: int | str) -> SensorHistory:
        """Return all calibrations of a sensor, coefficient by coefficient.

        Raises
        ------
        InputError
            If there is no such sensor, or it was never calibrated.
        """
        one = self.sensor(sensor)
        return build_history(one, self.calibrations(one.id))

    def noise_history(self, sensor: int | str) -> tuple[NoiseEntry, ...]:
        """Return the noise analyses of a sensor in the order of measurement."""
        return self._read(read_noise, sensor)

    def enter_noise(self, analysis: NoiseAnalysis, sensor: str, measured: str | None = None) -> int:
        """Enter a noise analysis of the named sensor, and return the number of the analysis.

        Raises
        ------
        InputError
            If the name is empty, or `measured` is not a time in ISO 8601.
        """
        with self._transaction(connection.write_transaction) as db:
            return enter_noise(db, analysis, sensor, measured, self._author())

    def enter_sensor(self, sensor: Sensor) -> int:
        """Enter a sensor and return its id; a sensor that is already registered keeps its id.

        Raises
        ------
        InputError
            If an axis measures a different quantity from the axis with this name in the register.
        """
        with self._transaction(connection.write_transaction) as db:
            return insertions.enter_sensor(db, sensor, self._author())

    def enter_run(
        self, facts: RunFacts, calibration: Calibration | str | Path | None = None
    ) -> int:
        """Enter a run and, if any, its calibration; return the id of the run.

        If the run is already registered, only its state, folder and files are updated.

        Raises
        ------
        InputError
            If the calibration file cannot be used. Nothing is entered in this case.
        """
        result = None if calibration is None else make_document(calibration)
        kind = "" if result is None else _bench_kind(result.calibration)
        with self._transaction(connection.write_transaction) as db:
            number = insertions.enter_run(db, facts, self._author())
            if result is not None:
                insertions.enter_calibration(db, result, kind, None, self._author())
            return number

    def enter_calibration(
        self, source: Calibration | str | Path, measured: str | None = None
    ) -> int:
        """Enter a calibration or a calibration file, and return its number.

        Parameters
        ----------
        source : Calibration or path
        measured : str, optional
            Time of measurement, ISO 8601. By default, it is the day in [job], or else the start of
            the run whose recording was calibrated, if the run is registered, or else the time of
            the calibration.

        Raises
        ------
        InputError
            If the file cannot be used, or `measured` is not a time, is in the future or
            contradicts [job].
        """
        return self.enter_calibrations((source,), measured)[0]

    def enter_calibrations(
        self, sources: Sequence[Calibration | str | Path], measured: str | None = None
    ) -> tuple[int, ...]:
        """Enter several calibrations, all or none of them, and return their numbers.

        A calibration that is already registered is not changed, except that `measured` replaces a
        date that is known only from its file.

        Raises
        ------
        InputError
            See `enter_calibration`. The error is also raised if a registered calibration has
            another date that was stated earlier or comes from its run.
        """
        if measured is not None:
            stated_time(measured, example=" or 2026-03-01T14:30:00+01:00")
        result = [make_document(source) for source in sources]
        if measured is not None:
            for one in result:
                insertions.require_possible_date(one, measured)
        kinds = [_bench_kind(one.calibration) for one in result]
        with self._transaction(connection.write_transaction) as db:
            numbers = tuple(
                insertions.enter_calibration(db, one, kind, measured, self._author())
                for one, kind in zip(result, kinds, strict=True)
            )
            if measured is not None:
                for number in numbers:
                    insertions.state_date(db, number, measured)
            return numbers

    def issue_certificate(
        self,
        source: Calibration | str | Path,
        wanted: certificates.CertificateRequest,
        measured: str,
    ) -> certificates.CertificateEntry:
        """Issue a certificate with the next number, and enter its calibration.

        Parameters
        ----------
        source : Calibration or path
        wanted : CertificateRequest
        measured : str
            Time of measurement, ISO 8601, for a calibration that is new to the register.

        Raises
        ------
        InputError
            If the file cannot be used, an earlier certificate is unknown, or the files of the
            certificate cannot be made. In these cases, no number is used.
        """
        document = make_document(source)
        kind = _bench_kind(document.calibration)
        with self._transaction(connection.write_transaction) as db:
            who = self._author()
            entered = insertions.enter_calibration(db, document, kind, measured, who)
            return certificates.issue_certificate(db, entered, wanted, who)

    def certificate(self, number: str) -> certificates.CertificateEntry:
        """Return the certificate with this number.

        Raises
        ------
        InputError
            If there is none.
        """
        return self._read(certificates.find_certificate, number)

    def certificates(self) -> tuple[certificates.CertificateSummary, ...]:
        """Return all certificates without their files, in the order of issue."""
        return self._read(certificates.list_certificates)

    def successors(self, number: str) -> tuple[tuple[str, str], ...]:
        """Return the number and kind of change of each certificate that changes this one."""
        return self._read(certificates.successors, number)

    def _author(self) -> insertions.EntryAuthor:
        return insertions.EntryAuthor(self._by, utc_now())

    def close(self) -> None:
        """Close the connection to the database."""
        self._engine.dispose()


def _bench_kind(calibration: Calibration) -> str:
    """Return the kind of bench that a calibration's method uses; empty for an unknown method."""
    # The methods are imported here because they load compiled kernels, which reading does not need.
    from inercal.benches.kind_definition import kind_name_for_class
    from inercal.methods import METHODS

    method = METHODS.get(calibration.method)
    return "" if method is None else kind_name_for_class(method.bench)

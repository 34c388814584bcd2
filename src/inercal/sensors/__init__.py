"""Sensors: coefficient tables, exact forward model, inverse and noise."""

from inercal.sensors.axis import Axis, Readout
from inercal.sensors.axis_model import Form
from inercal.sensors.catalogue import cluster, imu, pair, single, triad
from inercal.sensors.coefficient_tables import (
    ACCELEROMETER,
    G0,
    GROUPS,
    GYRO,
    SI_UNITS,
    TABLES,
    ErrorTerm,
)
from inercal.sensors.inverse import inverse
from inercal.sensors.noise import Noise
from inercal.sensors.sensor import Sensor

__all__ = [
    "ACCELEROMETER",
    "G0",
    "GROUPS",
    "GYRO",
    "SI_UNITS",
    "TABLES",
    "Axis",
    "ErrorTerm",
    "Form",
    "Noise",
    "Readout",
    "Sensor",
    "cluster",
    "imu",
    "inverse",
    "pair",
    "single",
    "triad",
]

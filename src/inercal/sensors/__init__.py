"""Sensors: coefficient tables, exact forward model, inverse and noise."""

from inercal.sensors.axis import Axis, Readout
from inercal.sensors.catalogue import cluster, imu, pair, single, triad
from inercal.sensors.inverse import inverse
from inercal.sensors.noise import Noise
from inercal.sensors.response import Form
from inercal.sensors.sensor import Sensor
from inercal.sensors.tables import ACCELEROMETER, G0, GROUPS, GYRO, SI_UNITS, TABLES, Coefficient

__all__ = [
    "ACCELEROMETER",
    "G0",
    "GROUPS",
    "GYRO",
    "SI_UNITS",
    "TABLES",
    "Axis",
    "Coefficient",
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

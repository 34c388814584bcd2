"""Sensor models: coefficient tables, exact forward model, inverse model and noise."""

from inercal.physics.sensors.axis import Axis, Noise, Readout, output_unit
from inercal.physics.sensors.axis_model import Form
from inercal.physics.sensors.catalogue import (
    Direction,
    axes_along,
    cluster,
    imu,
    pair,
    single,
    triad,
)
from inercal.physics.sensors.coefficient_tables import (
    ACCELEROMETER,
    G0,
    GROUPS,
    GYRO,
    SI_UNITS,
    TABLES,
    ErrorTerm,
)
from inercal.physics.sensors.inverse import inverse, nominal_inverse
from inercal.physics.sensors.sensor import Sensor

__all__ = [
    "ACCELEROMETER",
    "G0",
    "GROUPS",
    "GYRO",
    "SI_UNITS",
    "TABLES",
    "Axis",
    "Direction",
    "ErrorTerm",
    "Form",
    "Noise",
    "Readout",
    "Sensor",
    "axes_along",
    "cluster",
    "imu",
    "inverse",
    "nominal_inverse",
    "output_unit",
    "pair",
    "single",
    "triad",
]

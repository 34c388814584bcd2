"""A calibration: its coefficients, covariance and verdict, and the correction of readings."""

from inercal.calibration.calibration import Calibration
from inercal.calibration.forms import ConvertedCoefficients, Frame
from inercal.calibration.shared_errors import SharedError
from inercal.calibration.validity import Validity

__all__ = ["Calibration", "ConvertedCoefficients", "Frame", "SharedError", "Validity"]

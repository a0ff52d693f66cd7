"""One step of a forecaster as a file for any language, and fast steps in Python."""

from posecast.export.layout import Mode
from posecast.export.parity import Parity
from posecast.export.step_file import export_step, record_of
from posecast.export.stepper import Stepper

__all__ = ["Mode", "Parity", "Stepper", "export_step", "record_of"]

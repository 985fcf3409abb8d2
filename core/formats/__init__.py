"""Files of other programs and our own: landmarks, calibrations, the shot file."""

from .calibrations.calibration_files import load_cameras
from .calibrations.toml_cameras import save_cameras
from .trc import Landmarks, read_trc, write_trc

__all__ = ["Landmarks", "load_cameras", "read_trc", "save_cameras", "write_trc"]

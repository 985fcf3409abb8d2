"""Files of other programs and our own: landmarks, calibrations, the shot file."""

from .calibration_files import load_cameras, save_cameras
from .shot_toml import load_shot
from .trc import Landmarks, read_trc, write_trc

__all__ = ["Landmarks", "load_cameras", "load_shot", "read_trc", "save_cameras", "write_trc"]

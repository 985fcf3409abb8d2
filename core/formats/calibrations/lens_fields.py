"""Which lens model a calibration file means."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...errors import CalibrationError

_FISHEYE_MODELS = {"fisheye", "equidistant", "kannala_brandt", "kb4"}
"""Names that programs give to OpenCV's fisheye model."""
_FLAGS = {"true": True, "1": True, "1.0": True, "false": False, "0": False, "0.0": False}


def is_fisheye(table: Mapping[str, Any], where: str) -> bool:
    """Return whether a camera's coefficients are those of OpenCV's fisheye model: by `fisheye`, or by the name of the
    model.

    Raises
    ------
    CalibrationError
        `fisheye` is neither true nor false, nor a number or a text that means one of them.
    """
    models = {str(table.get(key, "")).lower() for key in ("distortion_model", "camera_model")}
    if "fisheye" not in table:
        return bool(models & _FISHEYE_MODELS)
    flag = _FLAGS.get(str(table["fisheye"]).lower())
    if flag is None:
        raise CalibrationError(f"'fisheye' must be true or false, not {str(table['fisheye'])[:20]!r}", where=where)
    return flag

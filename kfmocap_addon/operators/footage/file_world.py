"""The world of a calibration file: its unit of length and the axis that points up, chosen in the file browser."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ....core.errors import located
from ..mixin import OperatorMixin

if TYPE_CHECKING:
    from ....core.cameras.camera import Camera

_CHECKED = "CHECKED"
_STATE_UNIT = "choose its unit as Unit in the file browser, also if they really are that far apart"


class CalibrationReader(OperatorMixin):
    """An operator that reads the cameras of a calibration file, whatever the file's world."""

    unit: bpy.props.EnumProperty(
        items=[
            (_CHECKED, "Metres (Checked)", "Refused if the cameras would be more than 100 m apart"),
            ("m", "Metres", ""),
            ("cm", "Centimetres", ""),
            ("mm", "Millimetres", "As aniposelib, FreeMoCap and others write them if their boards are measured so"),
        ],
        name="Unit",
        description="Unit of length of the calibration file",
        default=_CHECKED,
        options={"SKIP_SAVE"},
    )
    up: bpy.props.EnumProperty(
        items=[
            ("z", "Z", "A warning says if all cameras are tilted as if another axis pointed up"),
            *((axis, axis.upper(), "") for axis in ("-z", "y", "-y", "x", "-x")),
        ],
        name="Up",
        description="Axis of the calibration file's world that points up",
        default="z",
        options={"SKIP_SAVE"},
    )

    def cameras_in(self, path: Path | str) -> dict[str, Camera]:
        """Read a calibration file; returns its cameras in our world, by name.

        Raises
        ------
        CalibrationError
        """
        from ....core.cameras.world_axes import FileWorld, upward_axis_warning
        from ....core.formats import load_cameras

        world = FileWorld(None if self.unit == _CHECKED else self.unit, self.up)
        cameras = {name: world.ours(camera) for name, camera in load_cameras(path).items()}
        with located(str(path)):
            world.check(tuple(cameras.values()), _STATE_UNIT)
        if doubt := upward_axis_warning(tuple(cameras.values())):
            self.report({"WARNING"}, f"{doubt}: if so, import again, with it as Up")
        return cameras

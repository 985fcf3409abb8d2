"""Commands and Blender: the command line reads and writes Blender's data here, and Blender runs the command line.

Importing it loads neither NumPy nor the core beyond its errors, as Blender does when it starts.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

from ..cli import command_line
from ..cli.services import Services
from . import registration
from .session import SESSION

if TYPE_CHECKING:
    from ..cli.services import OutputRequest, RetargetRequest
    from ..core.shot.shot import Shot
    from ..core.tracking.results.track_result import TrackResult

COMMAND = "kfmocap"
"""Name of the command: `blender ... --command kfmocap ...`."""


class BatchSession:
    """Blender as the commands use it; see `kfmocap.cli.services.BlenderSession`.

    It also works where the add-on is not switched on.
    """

    def open_file(self) -> Path | None:
        """See `BlenderSession.open_file`."""
        return Path(bpy.data.filepath) if bpy.data.filepath else None

    def read_shot(self) -> Shot:
        """Read the shot that the open scene shows."""
        from .scene_io import scene

        with registration.registered():
            return scene.shot_from_scene(bpy.context.scene)

    def check(self) -> None:
        """Do nothing: Blender is loaded already."""

    def prepare(self, shot: Shot, home: Path, beside: Path | None = None) -> None:
        """Do nothing: Blender is in this process, and cannot prepare a scene while it tracks."""

    def show_shot(self, shot: Shot, home: Path, beside: Path | None = None) -> None:
        """Show a shot that is going to be written, with `OutputRequest.shown`; the add-on stays switched on."""
        from .export import blender_outputs

        if not registration.is_registered():
            registration.register()
        blender_outputs.show_shot(shot, home, beside)

    def write_outputs(self, shot: Shot, result: TrackResult, request: OutputRequest) -> list[Path]:
        """Write the BVH and FBX files and shot.blend; returns the files written."""
        from .export import blender_outputs

        def add_fingers(scene: bpy.types.Scene) -> None:
            from .retargeting import finger_tracking

            finger_tracking.add_fingers(scene, request.hands)

        with registration.registered():
            finish = add_fingers if request.hands else None
            return blender_outputs.write_blender_outputs(shot, result, request, finish)

    def retarget(self, request: RetargetRequest) -> dict[str, Any]:
        """Put a motion on a character and save the file; returns the report."""
        from .retargeting import character_files

        with registration.registered():
            return character_files.retarget_file(request)


def register() -> None:
    """Give the Blender application its command; the module bpy takes none."""
    if hasattr(bpy.utils, "register_cli_command"):
        SESSION.on_end(bpy.utils.unregister_cli_command, bpy.utils.register_cli_command(COMMAND, run_command))


def run_command(argv: list[str]) -> int:
    """Run a command inside Blender; returns the exit code."""
    return command_line.main(argv, Services(load_blender=BatchSession, in_blender=True))

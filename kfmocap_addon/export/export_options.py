"""What to write of the performers of a shot."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ExportOptions:
    """What to write of the performers.

    Attributes
    ----------
    preset : str
        A key of `presets.PRESETS`.
    bvh, fbx, glb, vrma, usd : bool
        Which files: glb is glTF in one file, vrma VRM animation, usd USD in binary (.usdc).
    frames : tuple of int, optional
        First and last scene frame; by default those of the shot.
    fps : float, optional
        Frames per second of the files; by default the scene's.
    root_motion : bool
        The performers move through the world; else they stay over their first place, and only rise and sink.
    leave_out_unknown : bool
        Without the bones of parts that nothing has shown, but for those that others hang on.
    """

    preset: str = "BLENDER"
    bvh: bool = True
    fbx: bool = True
    frames: tuple[int, int] | None = None
    fps: float | None = None
    root_motion: bool = True
    glb: bool = False
    leave_out_unknown: bool = False
    vrma: bool = False
    usd: bool = False


DEFAULTS = ExportOptions()
"""BVH and FBX of all of the shot, with Blender's names and unit."""

"""Options of an export."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export.

    Attributes
    ----------
    preset : str
        A key of `presets.PRESETS`.
    bvh, fbx, glb, vrma, usd : bool
        Which files to write: glb is glTF in one file, vrma VRM animation, usd binary USD (.usdc).
    frames : tuple of int, optional
        First and last scene frame; by default those of the shot.
    fps : float, optional
        Frames per second of the files; by default the scene's.
    root_motion : bool
        Whether the performers move through the world; if not, they stay over their first position, and only rise and
        sink.
    leave_out_unknown : bool
        Whether to leave out bones of parts that nothing has shown, unless other bones are their descendants.
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

"""Options of an export."""

from __future__ import annotations

from dataclasses import dataclass

from .export_formats import EXPORT_FORMATS

_DEFAULT_FORMATS = tuple(name for name, known in EXPORT_FORMATS.items() if known.is_default)


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export.

    Attributes
    ----------
    preset : str
        A key of `presets.PRESETS`.
    formats : tuple of str
        Keys of `export_formats.EXPORT_FORMATS`: which files to write.
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
    formats: tuple[str, ...] = _DEFAULT_FORMATS
    frames: tuple[int, int] | None = None
    fps: float | None = None
    root_motion: bool = True
    leave_out_unknown: bool = False


DEFAULTS = ExportOptions()
"""BVH and FBX of all of the shot, with Blender's names and unit."""

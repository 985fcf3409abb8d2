"""The finished segments of a tracking that was stopped, by Esc or by closing Blender, stored in the add-on's folder."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import bpy

if TYPE_CHECKING:
    from ...core.shot.segments import Segment
    from ...core.tracking.results.journal import Journal

_REQUEST_FILE = "asked.json"
_ENDING = ".segment"


def segment_count(scene: bpy.types.Scene) -> int:
    """Return how many segments a stopped tracking of a scene has finished."""
    with suppress(OSError):
        return sum(entry.name.endswith(_ENDING) for entry in os.scandir(_folder(scene)))
    return 0


def begun(scene: bpy.types.Scene, asked: Sequence[Segment], *, resume: bool) -> Journal:
    """Return the journal of a new tracking, and store which segments were requested."""
    from ...core.tracking.results.journal import Journal

    if not resume:
        discard(scene)
    folder = _folder(scene)
    with suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        (folder / _REQUEST_FILE).write_text(json.dumps(list(asked)), encoding="utf-8")
    return Journal(folder, resume=resume)


def asked_segments(scene: bpy.types.Scene) -> set[Segment]:
    """Return which segments the stopped tracking was to track; none where that is not known."""
    with suppress(OSError, ValueError, TypeError, RecursionError):
        return {
            (first, last) for first, last in json.loads((_folder(scene) / _REQUEST_FILE).read_text(encoding="utf-8"))
        }
    return set()


def discard(scene: bpy.types.Scene) -> None:
    """Forget the tracking that was stopped, or is done."""
    from ...core.tracking.results.journal import Journal

    folder = _folder(scene)
    with suppress(OSError):
        (folder / _REQUEST_FILE).unlink(missing_ok=True)
    Journal(folder).discard()


def _folder(scene: bpy.types.Scene) -> Path:
    """Return a folder for each scene of each file: Blender keeps the file's name in what it saves by itself.

    Scenes that were never saved have the same names; these differ by their footage.
    """
    whose = [bpy.data.filepath or "\n".join(_footage(scene)), scene.name]
    name = hashlib.sha256("\n".join(whose).encode()).hexdigest()[:16]
    return Path(_own_folder(), "unfinished", name)


def _footage(scene: bpy.types.Scene) -> list[str]:
    cameras = [view.camera for view in scene.kfmocap.views if view.camera is not None]
    clips = [behind.clip for camera in cameras for behind in camera.data.background_images if behind.clip is not None]
    return [bpy.path.abspath(clip.filepath) for clip in clips]


def _own_folder() -> str:
    package = __package__.rpartition(".kfmocap_addon")[0]
    try:
        return str(bpy.utils.extension_path_user(package))
    except ValueError:  # not installed as an extension
        return str(bpy.utils.user_resource("DATAFILES", path="kfmocap"))
